"""Taking painted lines and lamps out of a picture before its regions are compared.

A painted edge line next to the edge, or a row of lamps, makes a stronger edge than that of the pavement, half a metre
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
_DARK = 95.0  # median grey level of the rows below which lamps are searched for
_LAMP_PX = 15  # narrower than this, and
_LAMP_GREY = 14  # brighter than its surroundings by so many grey levels
_GLOW_PX = 5
_SHORE_PX = 6  # averaged on either side of a glow


def remove_markings(image: ImageArray, rows_px: FloatArray, width_px: float) -> ImageArray:
    """Return a copy (h, w, 3) without lamps and bright markings narrower than ``width_px`` about the rows (2,).

    The picture itself where the width is 0; widths are rounded to whole odd numbers from 7 to 25.
    """
    if width_px <= 0.0:
        return image
    size = int(np.clip(2 * round(0.5 * width_px) + 1, _LEAST_PX, _MOST_PX))
    first = max(int(rows_px[0]) - _BESIDE_PX, 0)
    last = min(int(rows_px[1]) + _BESIDE_PX + 1, image.shape[0])
    if median_grey(image[first:last], 4) < _DARK:
        # no opening here: it darkens noisy areas, and a bridge is not one
        cleaned = image.copy()
        part = cleaned[first:last]
        bridge(part, lamp_mask(np.asarray(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY), np.uint8)))
        return cleaned
    cleaned = np.empty_like(image)
    cleaned[:first], cleaned[last:] = image[:first], image[last:]
    cleaned[first:last] = cv2.morphologyEx(image[first:last], cv2.MORPH_OPEN, np.ones((1, size), np.uint8))
    return cleaned


@njit(cache=True, nogil=True, error_model="numpy")
def median_grey(image: ImageArray, step: int) -> float:
    """Return the median of cv2's grey levels of every so many rows and columns of a picture (h, w, 3), by counting."""
    counts = np.zeros(256, np.int64)
    n = 0
    for i in range(0, image.shape[0], step):
        for j in range(0, image.shape[1], step):
            b, g, r = np.int64(image[i, j, 0]), np.int64(image[i, j, 1]), np.int64(image[i, j, 2])
            counts[(3735 * b + 19235 * g + 9798 * r + 16384) >> 15] += 1
            n += 1
    low, high, up_to = -1, 0, 0
    for level in range(256):
        up_to += counts[level]
        if low < 0 and up_to > (n - 1) // 2:
            low = level
        if up_to > n // 2:
            high = level
            break
    return 0.5 * (low + high)


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
