"""A coarse raster between its middles: as wide and as high as the picture that it was made of."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
Places = tuple[NDArray[np.int32], NDArray[np.int32], Float32Array]


@njit(cache=True, nogil=True)
def places_between(size: int, count: int, cells_per_px: float) -> Places:
    """Return for each of ``size`` pixels its two nearest of ``count`` cells and its distance from the first, 0–1.

    All three are (size,). Before the first cell's middle and beyond the last one's both are that cell.
    """
    gain, half = np.float32(cells_per_px), np.float32(0.5)
    first, second, share = np.empty(size, np.int32), np.empty(size, np.int32), np.empty(size, np.float32)
    for j in range(size):
        place = (np.float32(j) + half) * gain - half
        before = math.floor(place)
        first[j], second[j] = min(max(before, 0), count - 1), min(before + 1, count - 1)
        share[j] = place - np.float32(before)
    return first, second, share


@njit(cache=True, nogil=True, fastmath=True)
def widen(row: Float32Array, across: Places, out: Float32Array) -> None:
    """Write a row of cells (n,) as wide as the picture is, (w,)."""
    first, second, share = across
    one = np.float32(1)
    for j in range(out.size):
        # unsigned: of an index that may be below zero the compiler tests each
        out[j] = (one - share[j]) * row[np.uint32(first[j])] + share[j] * row[np.uint32(second[j])]


@njit(cache=True, nogil=True)
def widened(cells: Float32Array, w: int) -> Float32Array:
    """Return cells (rows, columns) over all of a picture with rows as wide as that, (rows, w)."""
    rows, columns = cells.shape
    across = places_between(w, columns, columns / w)
    wide = np.empty((rows, w), np.float32)
    for a in range(rows):
        widen(cells[a], across, wide[a])
    return wide
