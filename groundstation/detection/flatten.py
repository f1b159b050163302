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
_ALIKE = 12  # squared grey levels over three channels: not worth looking at the neighbours
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
def _subtract(
    image: ImageArray,
    smooth: Float32Array,
    median: ImageArray,
    edges: NDArray[np.bool_],
    step: int,
    out: Float32Array,
) -> None:
    """Write grey, blue minus red and green minus magenta of the image less its background into (3, h, w)."""
    h, w = image.shape[:2]
    for i in range(h):
        for j in range(w):
            blue = np.float32(image[i, j, 0]) - smooth[i, j, 0]
            green = np.float32(image[i, j, 1]) - smooth[i, j, 1]
            red = np.float32(image[i, j, 2]) - smooth[i, j, 2]
            out[0, i, j] = np.float32(0.114) * blue + np.float32(0.587) * green + np.float32(0.299) * red
            out[1, i, j] = np.float32(0.5) * (blue - red)
            out[2, i, j] = np.float32(0.5) * green - np.float32(0.25) * (blue + red)
        a = i // step
        for b in range(median.shape[1]):
            if edges[a, b]:
                for j in range(b * step, min((b + 1) * step, w)):
                    _nearest(image, median, a, b, i, j, out)


@njit(cache=True, nogil=True, inline="always")
def _apart(blue: int, green: int, red: int, median: ImageArray, p: int, q: int) -> tuple[int, int, int]:
    """Return how far a colour is from a block's; whole numbers without a sign would wrap."""
    return blue - np.int32(median[p, q, 0]), green - np.int32(median[p, q, 1]), red - np.int32(median[p, q, 2])


@njit(cache=True, nogil=True, inline="always")
def _nearest(image: ImageArray, median: ImageArray, a: int, b: int, i: int, j: int, out: Float32Array) -> None:
    """Write one pixel's difference from the one of the nine nearest blocks that it resembles most."""
    blue, green, red = np.int32(image[i, j, 0]), np.int32(image[i, j, 1]), np.int32(image[i, j, 2])
    d_blue, d_green, d_red = _apart(blue, green, red, median, a, b)
    least = d_blue * d_blue + d_green * d_green + d_red * d_red
    if least > _ALIKE:
        for p in range(max(a - 1, 0), min(a + 2, median.shape[0])):
            for q in range(max(b - 1, 0), min(b + 2, median.shape[1])):
                e0, e1, e2 = _apart(blue, green, red, median, p, q)
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
    rows, columns = median.shape[:2]
    smooth = cv2.resize(median.astype(np.float32), (columns * step, rows * step), interpolation=cv2.INTER_LINEAR)
    _subtract(image, np.asarray(smooth, np.float32), median, _edges(median), step, out)
    return out
