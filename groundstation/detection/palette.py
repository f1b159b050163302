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
def _bin(value: float, width: float, bins: int) -> int:
    """Return the palette bin of one residual."""
    return min(max(int(value / width + 0.5 * bins), 0), bins - 1)


@njit(cache=True, nogil=True)
def _palette(residual: Float32Array, width: FloatArray, keep_out: tuple[int, int, int, int]) -> Float32Array:
    """Return what is left of each colour bin's contrast, by its share among the residuals outside the box."""
    x0, y0, x1, y1 = keep_out
    shape = (_BINS[0], _BINS[1], _BINS[2])
    count = np.zeros(shape, np.int32)
    n = 0
    for i in range(0, residual.shape[1], 2):
        for j in range(0, residual.shape[2], 2):
            if y0 <= i < y1 and x0 <= j < x1:
                continue
            a = _bin(residual[0, i, j], width[0], shape[0])
            b = _bin(residual[1, i, j], width[1], shape[1])
            c = _bin(residual[2, i, j], width[2], shape[2])
            count[a, b, c] += 1
            n += 1
    share = np.zeros(shape, np.float32)
    for a in range(shape[0]):
        for b in range(shape[1]):
            for c in range(shape[2]):
                if count[a, b, c] == 0:
                    continue
                value = np.float32(count[a, b, c] / n)
                for p in range(max(a - 1, 0), min(a + 2, shape[0])):
                    for q in range(max(b - 1, 0), min(b + 2, shape[1])):
                        for r in range(max(c - 1, 0), min(c + 2, shape[2])):
                            share[p, q, r] += value
    low, high = math.log(_COMMON), math.log(_RARE)
    for a in range(shape[0]):
        for b in range(shape[1]):
            for c in range(shape[2]):
                rarity = (math.log(share[a, b, c]) - low) / (high - low) if share[a, b, c] > _RARE else 1.0
                share[a, b, c] = max(0.0, rarity)
    return share


@njit(cache=True, nogil=True)
def _discount(residual: Float32Array, width: FloatArray, left: Float32Array, contrast: Float32Array) -> None:
    """Scale the contrast of each pixel down where its colour is common in the surroundings."""
    for i in range(contrast.shape[0]):
        for j in range(contrast.shape[1]):
            if contrast[i, j] > _NOISE:
                a = _bin(residual[0, i, j], width[0], left.shape[0])
                b = _bin(residual[1, i, j], width[1], left.shape[1])
                contrast[i, j] *= left[a, b, _bin(residual[2, i, j], width[2], left.shape[2])]


def discount_common_colours(
    residual: Float32Array, sigmas: FloatArray, keep_out: tuple[int, int, int, int], contrast: Float32Array
) -> None:
    """Scale ``contrast`` (h, w) down in place where the residual's colour is common outside the box.

    ``residual`` (3, h, w) is against the flattened background, ``sigmas`` (3,) its usual spread, ``keep_out``
    x0, y0, x1, y1 the place of the target.
    """
    width = _BIN_SIGMAS * sigmas
    _discount(residual, width, _palette(residual, width, keep_out), contrast)
