"""Taking painted lines and lamps out of a picture before its regions are compared.

A painted edge line beside the edge, or a row of lamps, makes a stronger edge than that of the pavement, half a metre
to a metre off it. Paint is bright and narrow; an opening along the rows (the largest of the smallest) takes away what
is brighter than its surroundings and narrower than a given width, and leaves wider regions where they are. The glow of
a lamp by night touches the pavement, whose colour an opening would give to it: there the row is bridged instead from
one side of the glow to the other.
"""

import cv2
import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray

_LEAST_PX, _MOST_PX = 7, 25
_BESIDE_PX = 24
_DARK = 95.0  # median grey level of the rows below which lamps are looked for
_LAMP_PX = 15  # narrower than this, and
_LAMP_GREY = 14  # brighter than its surroundings by so many grey levels
_GLOW_PX = 5
_SHORE_PX = 6  # averaged on either side of a glow


def without_paint(image: ImageArray, rows_px: FloatArray, width_px: float) -> ImageArray:
    """Return a copy (h, w, 3) without lamps and bright marks narrower than ``width_px`` about the rows (2,).

    The picture itself where the width is 0; widths are rounded to whole odd numbers from 7 to 25.
    """
    if width_px <= 0.0:
        return image
    size = int(np.clip(2 * round(0.5 * width_px) + 1, _LEAST_PX, _MOST_PX))
    first = max(int(rows_px[0]) - _BESIDE_PX, 0)
    last = min(int(rows_px[1]) + _BESIDE_PX + 1, image.shape[0])
    cleaned = image.copy()
    part = cleaned[first:last]
    grey = np.asarray(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY), np.uint8)
    if float(np.median(grey[::4, ::4])) < _DARK:
        # no opening here: it darkens what is noisy, and a bridge is not
        bridge(part, lamp_mask(grey))
        return cleaned
    cleaned[first:last] = cv2.morphologyEx(part, cv2.MORPH_OPEN, np.ones((1, size), np.uint8))
    return cleaned


def lamp_mask(grey: ImageArray) -> ImageArray:
    """Return where lamps and their glow are in a dark picture (h, w): 1 there, 0 elsewhere."""
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.2)
    hat = cv2.morphologyEx(smooth, cv2.MORPH_TOPHAT, np.ones((_LAMP_PX, _LAMP_PX), np.uint8))
    return np.asarray(cv2.dilate((hat > _LAMP_GREY).astype(np.uint8), np.ones((_GLOW_PX, _GLOW_PX), np.uint8)))


@njit(cache=True, nogil=True)
def bridge(image: ImageArray, mask: ImageArray) -> None:
    """Replace the masked runs of each row by a straight line between their neighbours, in place."""
    h, w = mask.shape
    for i in range(h):
        j = 0
        while j < w:
            if mask[i, j] == 0:
                j += 1
                continue
            end = j
            while end < w and mask[i, end] != 0:
                end += 1
            low, high = max(j - _SHORE_PX, 0), min(end + _SHORE_PX, w)
            for c in range(image.shape[2]):
                left, right = 0.0, 0.0
                for m in range(low, j):
                    left += image[i, m, c] / (j - low)
                for m in range(end, high):
                    right += image[i, m, c] / (high - end)
                left, right = (right if j == low else left), (left if high == end else right)
                for m in range(j, end):
                    f = (m - j + 1) / (end - j + 1)
                    # rounded, not cut off
                    image[i, m, c] = np.uint8((1.0 - f) * left + f * right + 0.5)
            j = end
