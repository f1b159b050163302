"""The palette of the surroundings: a colour that is common around the target is not the target's.

White paint stands out against a runway as an aircraft does, but there is more of it elsewhere in the window.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray

Float32Array = NDArray[np.float32]

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
def _palette(
    residual: Float32Array, per_level: NDArray[np.float32], keep_out: tuple[int, int, int, int]
) -> Float32Array:
    """Return the smoothed share of each colour bin among the residuals outside the box."""
    x0, y0, x1, y1 = keep_out
    shape = (_BINS[0], _BINS[1], _BINS[2])
    count = np.zeros(shape[0] * shape[1] * shape[2], np.int32)
    used = np.empty(count.size, np.int32)
    places = np.empty((residual.shape[2] + 1) // 2, np.int32)
    n, bins = 0, 0
    for i in range(0, residual.shape[1], 2):
        grey, blue_red, magenta = residual[0, i], residual[1, i], residual[2, i]
        # all of a row's places first, which the compiler does many at a time
        for k in range(places.size):
            a = _bin(grey[2 * k], per_level[0], shape[0])
            b = _bin(blue_red[2 * k], per_level[1], shape[1])
            places[k] = (a * shape[1] + b) * shape[2] + _bin(magenta[2 * k], per_level[2], shape[2])
        beside = y0 <= i < y1
        for k in range(places.size):
            if beside and x0 <= 2 * k < x1:
                continue
            place = places[k]
            if count[place] == 0:
                used[bins] = place
                bins += 1
            count[place] += 1
            n += 1
    share = np.zeros(shape, np.float32)
    for k in range(bins):
        a, b, c = used[k] // (shape[1] * shape[2]), used[k] // shape[2] % shape[1], used[k] % shape[2]
        value = np.float32(count[used[k]] / n)
        for p in range(max(a - 1, 0), min(a + 2, shape[0])):
            for q in range(max(b - 1, 0), min(b + 2, shape[1])):
                for r in range(max(c - 1, 0), min(c + 2, shape[2])):
                    share[p, q, r] += value
    return share


@njit(cache=True, nogil=True)
def _discount(
    residual: Float32Array, per_level: NDArray[np.float32], share: Float32Array, contrast: Float32Array
) -> None:
    """Scale the contrast of each pixel down where its colour is common in the surroundings."""
    low, high = math.log(_COMMON), math.log(_RARE)
    # of a bin only when a pixel asks for it, and once: few of all are asked for
    factor = np.full(share.size, np.float32(-1))
    shares = share.ravel()
    for i in range(contrast.shape[0]):
        row, grey, blue_red, magenta = contrast[i], residual[0, i], residual[1, i], residual[2, i]
        for j in range(row.size):
            if row[j] > _NOISE:
                a = _bin(grey[j], per_level[0], share.shape[0])
                b = _bin(blue_red[j], per_level[1], share.shape[1])
                k = (a * share.shape[1] + b) * share.shape[2] + _bin(magenta[j], per_level[2], share.shape[2])
                if factor[k] < 0:
                    common = shares[k] > _RARE
                    factor[k] = max(0.0, (math.log(shares[k]) - low) / (high - low)) if common else 1.0
                row[j] *= factor[k]


@njit(cache=True, nogil=True)
def discount_common_colours(
    residual: Float32Array, sigmas: FloatArray, keep_out: tuple[int, int, int, int], contrast: Float32Array
) -> None:
    """Scale ``contrast`` (h, w) down in place where the residual's colour is common outside the box.

    ``residual`` (3, h, w) is against the flattened background, ``sigmas`` (3,) its usual spread, ``keep_out``
    x0, y0, x1, y1 the place of the target.
    """
    per_level = (1.0 / (_BIN_SIGMAS * sigmas)).astype(np.float32)
    _discount(residual, per_level, _palette(residual, per_level, keep_out), contrast)
