"""The spatial background of a window: a large median that keeps edges, at a small part of its price.

The median is taken over means of square blocks, five by five of them to the window. Where it varies little it is
interpolated; where it has an edge (the horizon, a tree line) each pixel takes the one of the nearest blocks that
it resembles most, so that both sides of the edge come out flat and only what neither side explains remains.
"""

import math

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import ImageArray

Float32Array = NDArray[np.float32]

_BLOCKS = 5  # across the median's window
_FLAT = 6  # grey levels between neighbouring blocks that interpolation bridges


@njit(cache=True, nogil=True)
def _block_means(image: ImageArray, step: int) -> ImageArray:
    """Return the (⌈h/step⌉, ⌈w/step⌉, 3) means of square blocks; those at the far edges may be cut."""
    h, w = image.shape[:2]
    rows, columns = (h + step - 1) // step, (w + step - 1) // step
    means = np.empty((rows, columns, 3), np.uint8)
    total = np.empty(3 * columns, np.int32)
    for a in range(rows):
        total[:] = 0
        first, last = a * step, min((a + 1) * step, h)
        for i in range(first, last):
            for b in range(columns):
                s0, s1, s2 = 0, 0, 0
                for j in range(b * step, min((b + 1) * step, w)):
                    s0 += image[i, j, 0]
                    s1 += image[i, j, 1]
                    s2 += image[i, j, 2]
                total[3 * b] += s0
                total[3 * b + 1] += s1
                total[3 * b + 2] += s2
        for b in range(columns):
            n = (last - first) * (min((b + 1) * step, w) - b * step)
            for c in range(3):
                means[a, b, c] = (total[3 * b + c] + n // 2) // n
    return means


@njit(cache=True, nogil=True)
def _edges(median: ImageArray) -> NDArray[np.bool_]:
    """Return the blocks whose neighbourhood holds an edge."""
    rows, columns = median.shape[:2]
    found = np.zeros((rows, columns), np.bool_)
    for a in range(rows):
        for b in range(columns):
            for c in range(3):
                low, high = 255, 0
                for p in range(max(a - 1, 0), min(a + 2, rows)):
                    for q in range(max(b - 1, 0), min(b + 2, columns)):
                        low, high = min(low, median[p, q, c]), max(high, median[p, q, c])
                if high - low > _FLAT:
                    found[a, b] = True
                    break
    return found


@njit(cache=True, nogil=True, fastmath=True)
def _subtract(image: ImageArray, median: ImageArray, edges: NDArray[np.bool_], step: int, out: Float32Array) -> None:
    """Write grey, blue minus red and green minus magenta of the image less its background into (3, h, w)."""
    h, w = image.shape[:2]
    rows, columns = median.shape[:2]
    line = np.empty((3, columns), np.float32)
    left, share = np.empty(w, np.int32), np.empty(w, np.float32)
    for j in range(w):
        place = min(max((j + 0.5) / step - 0.5, 0.0), columns - 1.0)
        left[j] = min(int(place), max(columns - 2, 0))
        share[j] = place - left[j] if columns > 1 else 0.0
    right = 1 if columns > 1 else 0
    for i in range(h):
        place = min(max((i + 0.5) / step - 0.5, 0.0), rows - 1.0)
        top = min(int(place), max(rows - 2, 0))
        bottom = min(top + 1, rows - 1)
        down = np.float32(place - top)
        for b in range(columns):
            for c in range(3):
                line[c, b] = (np.float32(1) - down) * median[top, b, c] + down * median[bottom, b, c]
        for j in range(w):
            k, f = left[j], share[j]
            blue = np.float32(image[i, j, 0]) - (line[0, k] + f * (line[0, k + right] - line[0, k]))
            green = np.float32(image[i, j, 1]) - (line[1, k] + f * (line[1, k + right] - line[1, k]))
            red = np.float32(image[i, j, 2]) - (line[2, k] + f * (line[2, k + right] - line[2, k]))
            out[0, i, j] = np.float32(0.114) * blue + np.float32(0.587) * green + np.float32(0.299) * red
            out[1, i, j] = np.float32(0.5) * (blue - red)
            out[2, i, j] = np.float32(0.5) * green - np.float32(0.25) * (blue + red)
        a = i // step
        for b in range(columns):
            if edges[a, b]:
                for j in range(b * step, min((b + 1) * step, w)):
                    _nearest(image, median, a, b, i, j, out)


@njit(cache=True, nogil=True, inline="always")
def _nearest(image: ImageArray, median: ImageArray, a: int, b: int, i: int, j: int, out: Float32Array) -> None:
    """Write one pixel's difference from the one of the nine nearest blocks that it resembles most."""
    blue, green, red = np.int32(image[i, j, 0]), np.int32(image[i, j, 1]), np.int32(image[i, j, 2])
    least = np.int32(1 << 30)
    d_blue, d_green, d_red = np.int32(0), np.int32(0), np.int32(0)
    for p in range(max(a - 1, 0), min(a + 2, median.shape[0])):
        for q in range(max(b - 1, 0), min(b + 2, median.shape[1])):
            # whole numbers without a sign would wrap
            e0 = blue - np.int32(median[p, q, 0])
            e1 = green - np.int32(median[p, q, 1])
            e2 = red - np.int32(median[p, q, 2])
            misfit = e0 * e0 + e1 * e1 + e2 * e2
            if misfit < least:
                least = misfit
                d_blue, d_green, d_red = e0, e1, e2
    out[0, i, j] = 0.114 * d_blue + 0.587 * d_green + 0.299 * d_red
    out[1, i, j] = 0.5 * (d_blue - d_red)
    out[2, i, j] = 0.5 * d_green - 0.25 * (d_blue + d_red)


def flatten(image: ImageArray, window: float) -> Float32Array:
    """Return the image less its background.

    Parameters
    ----------
    image : (h, w, 3) uint8 BGR.
    window : width of the median in px; what is much smaller than it stays in the difference.

    Returns
    -------
    (3, h, w) float32: grey, blue minus red and green minus magenta, in grey levels.
    """
    step = max(math.floor(window / _BLOCKS + 0.5), 1)
    median = np.asarray(cv2.medianBlur(_block_means(image, step), _BLOCKS), np.uint8)
    out = np.empty((3, *image.shape[:2]), np.float32)
    _subtract(image, median, _edges(median), step, out)
    return out
