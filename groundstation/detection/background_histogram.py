"""Colour histogram of the surroundings: colours that are common around the target belong to the background.

White paint stands out against a runway as an aircraft does, but there is more of it elsewhere in the window.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.box import Box

Float32Array = NDArray[np.float32]
Bins = NDArray[np.uint16]

# the palette of the surroundings: bins of the residual's grey, blue-red and green, and the shares of the
# surroundings from which a colour is taken for background, and below which it is not
_BINS = (32, 24, 16)
_BIN_SIGMAS = 1.5
_COMMON, _RARE = 0.02, 0.002
_NOISE = 2.0  # sigmas: less is nothing in any case


@njit(cache=True, nogil=True, inline="always")
def _bin(value: np.float32, per_level: np.float32, bins: int) -> np.int32:
    """Return the palette bin of one residual."""
    place = min(max(value * per_level + np.float32(0.5 * bins), np.float32(0)), np.float32(bins - 1))
    return np.int32(place)


@njit(cache=True, nogil=True)
def _bins_of(residual: Float32Array, per_level: NDArray[np.float32]) -> Bins:
    """Return the palette bin, as one number, of each pixel of a residual (3, h, w)."""
    bins = np.empty((residual.shape[1], residual.shape[2]), np.uint16)
    for i in range(bins.shape[0]):
        row, grey, blue_red, magenta = bins[i], residual[0, i], residual[1, i], residual[2, i]
        for j in range(row.size):
            a, b = _bin(grey[j], per_level[0], _BINS[0]), _bin(blue_red[j], per_level[1], _BINS[1])
            row[j] = (a * _BINS[1] + b) * _BINS[2] + _bin(magenta[j], per_level[2], _BINS[2])
    return bins


@njit(cache=True, nogil=True)
def _palette(bins: Bins, keep_out: Box[int]) -> Float32Array:
    """Return the smoothed share of each colour bin among the pixels (h, w) outside a box inside them."""
    x0, y0, x1, y1 = keep_out
    shape = (_BINS[0], _BINS[1], _BINS[2])
    count = np.zeros(shape[0] * shape[1] * shape[2], np.int32)
    used = np.empty(count.size, np.int32)
    n, different = 0, 0
    for i in range(0, bins.shape[0], 2):
        row, crosses_box = bins[i], y0 <= i < y1
        for part in range(2):
            first, last = (0, x0) if part == 0 else ((x1 + 1) // 2 * 2, row.size)
            if not crosses_box:
                first, last = (0, row.size) if part == 0 else (0, 0)
            for j in range(first, last, 2):
                place = row[np.uint32(j)]
                if count[place] == 0:
                    used[different] = place
                    different += 1
                count[place] += 1
                n += 1
    share = np.zeros(shape, np.float32)
    for k in range(different):
        a, b, c = used[k] // (shape[1] * shape[2]), used[k] // shape[2] % shape[1], used[k] % shape[2]
        value = np.float32(count[used[k]] / n)
        for p in range(max(a - 1, 0), min(a + 2, shape[0])):
            for q in range(max(b - 1, 0), min(b + 2, shape[1])):
                for r in range(max(c - 1, 0), min(c + 2, shape[2])):
                    share[p, q, r] += value
    return share


@njit(cache=True, nogil=True)
def _discount(bins: Bins, share: Float32Array, contrast: Float32Array) -> None:
    """Scale the contrast of each pixel (h, w) down where its colour is common in the surroundings."""
    low, high = math.log(_COMMON), math.log(_RARE)
    # computed once per bin, on the first request, because few bins of all are requested
    factor = np.full(share.size, np.float32(-1))
    shares, strong = share.ravel(), np.empty(contrast.shape[1], np.uint32)
    for i in range(contrast.shape[0]):
        row, own = contrast[i], bins[i]
        # the counted pixels are found without a branch, which would often be mispredicted
        n = 0
        for j in range(row.size):
            strong[n] = j
            n += row[j] > np.float32(_NOISE)
        for m in range(n):
            j = strong[m]
            k = own[j]
            if factor[k] < 0:
                common = shares[k] > _RARE
                factor[k] = max(0.0, (math.log(shares[k]) - low) / (high - low)) if common else 1.0
            row[j] *= factor[k]


@njit(cache=True, nogil=True)
def suppress_background_colours(
    residual: Float32Array, sigmas: FloatArray, keep_out: Box[int], contrast: Float32Array
) -> None:
    """Scale ``contrast`` (h, w) down in place where the residual's colour is common outside the box.

    ``residual`` (3, h, w) is against the flattened background, ``sigmas`` (3,) its usual spread, ``keep_out``
    the box of the target.
    """
    per_level = (1.0 / (_BIN_SIGMAS * sigmas)).astype(np.float32)
    bins = _bins_of(residual, per_level)
    _discount(bins, _palette(bins, keep_out), contrast)
