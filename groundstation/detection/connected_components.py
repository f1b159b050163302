"""Connected regions of a picture as runs of its rows: pixels inside are visited once, those outside hardly."""

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

LabelArray = NDArray[np.int32]


@njit(cache=True, nogil=True)
def connected_runs(inside: NDArray[Any]) -> tuple[LabelArray, LabelArray, int]:
    """Return the rows' runs of values above 0 in a picture (h, w), 8-connected.

    They are (n, 3): row, first column, last + 1, in reading order; with them the region of each,
    (n,), counted from 1 in the order of their first pixels, and the number of regions + 1.
    """
    h, w = inside.shape
    most = h * (w // 2 + 1)
    runs, parent = np.empty((most, 3), np.int32), np.empty(most, np.int32)
    n = _link(inside, runs, parent)
    number = np.zeros(n, np.int32)
    count = 1
    for k in range(n):
        if parent[k] == k:
            number[k] = count
            count += 1
        else:
            number[k] = number[_root(parent, k)]
    return runs[:n], number, count


@njit(cache=True, nogil=True)
def _root(parent: NDArray[np.int32], k: int) -> int:
    """Return the first run of the region that run k belongs to, and shorten the way to it."""
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@njit(cache=True, nogil=True)
def _link(inside: NDArray[Any], runs: LabelArray, parent: LabelArray) -> int:
    """Write the rows' runs as row, first, last + 1 and link those that touch; returns their number."""
    h, w = inside.shape
    n, above, own = 0, 0, 0
    for i in range(h):
        left = np.int32(0)
        for j in range(w):
            left += np.int32(inside[i, j] > 0)
        above, own, j = own, n, 0
        before = above
        while left > 0 and j < w:
            if inside[i, j] <= 0:
                j += 1
                continue
            first = j
            while j < w and inside[i, j] > 0:
                j += 1
            runs[n, 0], runs[n, 1], runs[n, 2], parent[n] = i, first, j, n
            left -= j - first
            # a run of the row above touches it, if only by a corner
            while before < own and runs[before, 2] < first:
                before += 1
            k = before
            while k < own and runs[k, 1] <= j:
                one, other = _root(parent, k), _root(parent, n)
                parent[max(one, other)] = min(one, other)
                k += 1
            n += 1
    return n
