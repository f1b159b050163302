"""Compiled patterns of a scenery: lattice noise without aliasing, soft edges, mixing of colours, the sun's glow."""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray

# weight of a layer by that of the one before
_WEAKER = 0.62
_ROUNDING = 1e-9


@njit(cache=True, nogil=True)
def lattice(ix: int, iy: int, seed: int) -> float:
    """Return a number of 0 to 1 that belongs to a point of the lattice."""
    h = (ix * 0x1F1F1F1F + iy * 0x5BD1E995 + seed * 0x27D4EB2F) & 0xFFFFFFFF
    h ^= h >> 15
    h = (h * 0x2C1B3C6D) & 0xFFFFFFFF
    h ^= h >> 12
    h = (h * 0x297A2D39) & 0xFFFFFFFF
    h ^= h >> 15
    return h / 4294967296.0


@njit(cache=True, nogil=True)
def noise(x: float, y: float, seed: int) -> float:
    """Return smooth noise of 0 to 1 with wavelength of about 2 in x and y."""
    fx, fy = np.floor(x), np.floor(y)
    ix, iy = int(fx), int(fy)
    a, b = x - fx, y - fy
    a, b = a * a * (3.0 - 2.0 * a), b * b * (3.0 - 2.0 * b)
    low = (1.0 - a) * lattice(ix, iy, seed) + a * lattice(ix + 1, iy, seed)
    high = (1.0 - a) * lattice(ix, iy + 1, seed) + a * lattice(ix + 1, iy + 1, seed)
    return (1.0 - b) * low + b * high


@njit(cache=True, nogil=True)
def layers(x: float, y: float, cell: float, covered: float, count: int, seed: int) -> float:
    """Return a sum of noises around 0, each of half the cell of the one before, faded where pixels cover it."""
    total, weight = 0.0, 1.0
    for k in range(count):
        ratio = covered / cell
        if ratio > 2.0:
            break
        fade = 1.0 / (1.0 + 4.0 * ratio * ratio)
        total += weight * fade * (noise(x / cell, y / cell, seed + k) - 0.5)
        weight *= _WEAKER
        cell *= 0.5
    return total


@njit(cache=True, nogil=True)
def layers_within(
    x: float, y: float, cell: float, covered: float, count: int, seed: int, low: float, high: float
) -> float:
    """Return `layers` where they are between two bounds, otherwise any value beyond the same bound.

    The layers not yet added are below a geometric series.
    """
    total, weight = 0.0, 1.0
    for k in range(count):
        ratio = covered / cell
        if ratio > 2.0:
            break
        fade = 1.0 / (1.0 + 4.0 * ratio * ratio)
        total += weight * fade * (noise(x / cell, y / cell, seed + k) - 0.5)
        weight *= _WEAKER
        cell *= 0.5
        most = 0.5 * weight / (1.0 - _WEAKER) + _ROUNDING
        if total + most < low or total - most > high:
            break
    return total


@njit(cache=True, nogil=True)
def step(value: float, width: float) -> float:
    """Return a step at 0 that takes a width: 0 before, 1 after."""
    return min(max(value / max(width, 1e-9) + 0.5, 0.0), 1.0)


@njit(cache=True, nogil=True)
def within(value: float, low: float, high: float, width: float) -> float:
    """Return which share of a width around a value lies between two edges."""
    return max(step(value - low, width) - step(value - high, width), 0.0)


@njit(cache=True, nogil=True)
def smooth(value: float) -> float:
    """Return a smooth step from 0 at 0 to 1 at 1."""
    v = min(max(value, 0.0), 1.0)
    return v * v * (3.0 - 2.0 * v)


@njit(cache=True, nogil=True)
def mix(colour: FloatArray, share: float, b: float, g: float, r: float) -> None:
    """Replace a share of a colour (3,)."""
    colour[0] += share * (b - colour[0])
    colour[1] += share * (g - colour[1])
    colour[2] += share * (r - colour[2])


@njit(cache=True, nogil=True)
def glow(cosine: float, strength: float) -> float:
    """Return the levels by which the sky is brighter at an angle of this cosine from the sun."""
    if strength <= 0.0:
        return 0.0
    angle = np.arccos(min(max(cosine, -1.0), 1.0))
    # forward scattering by haze: a bright aureole of some degrees in a wide faint one
    return strength * (0.65 * np.exp(-angle / 0.05) + 0.35 * np.exp(-angle / 0.28))
