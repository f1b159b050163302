"""Taking painted lines and lamps out of a picture before its regions are compared.

A painted edge line beside the edge, or a row of lamps, makes a stronger edge than that of the pavement, half a metre
to a metre off it. Both are bright and narrow; an opening along the rows (the largest of the smallest) takes away what
is brighter than its surroundings and narrower than a given width, and leaves wider regions where they are.
"""

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray

_LEAST_PX, _MOST_PX = 7, 25
_BESIDE_PX = 24


def without_paint(image: ImageArray, rows_px: FloatArray, width_px: float) -> ImageArray:
    """Return a copy (h, w, 3) in which bright marks narrower than ``width_px`` are gone about the rows (2,).

    The picture itself where the width is 0; widths are rounded to whole odd numbers from 7 to 25.
    """
    if width_px <= 0.0:
        return image
    size = int(np.clip(2 * round(0.5 * width_px) + 1, _LEAST_PX, _MOST_PX))
    first = max(int(rows_px[0]) - _BESIDE_PX, 0)
    last = min(int(rows_px[1]) + _BESIDE_PX + 1, image.shape[0])
    opened = image.copy()
    opened[first:last] = cv2.morphologyEx(image[first:last], cv2.MORPH_OPEN, np.ones((1, size), np.uint8))
    return opened
