"""Thickest point of a silhouette: the maximum of the response to a disc of the fuselage's radius."""

import math
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray

Float32Array = NDArray[np.float32]

_FLANK_WEIGHT = 0.3
_FLANK_RADII = 2.5
_MAX_ROLL_RAD = math.radians(35.0)
_SUBPIXEL = 4
_RADIUS_STEP_PX = 0.1


@lru_cache(maxsize=64)
def disc_kernel(steps: int) -> Float32Array:
    """Return a disc of radius ``steps`` × `_RADIUS_STEP_PX`, anti-aliased, that sums to one."""
    radius = steps * _RADIUS_STEP_PX
    half = math.ceil(radius)
    fine = (np.arange((2 * half + 1) * _SUBPIXEL) + 0.5) / _SUBPIXEL - half - 0.5
    inside = (fine[:, None] ** 2 + fine[None, :] ** 2 <= radius * radius).astype(np.float32)
    n = 2 * half + 1
    disc = inside.reshape(n, _SUBPIXEL, n, _SUBPIXEL).mean(axis=(1, 3))
    return np.asarray(disc / disc.sum(), np.float32)


def disc_maximum(membership: Float32Array, radius: float) -> FloatArray:
    """Return the place (2,) where a disc is filled best and, along the wing, its neighbourhood is not.

    A wing that blur has thickened holds a disc, too, but then its neighbours along the wing hold one as well.

    Parameters
    ----------
    membership : (h, w) of the silhouette, in [0, 1].
    radius : of the disc, px.
    """
    return _fullest(membership, disc_kernel(round(radius / _RADIUS_STEP_PX)), _FLANK_RADII * radius)


@njit(cache=True, nogil=True, fastmath=True)
def filled_share(membership: Float32Array, disc: Float32Array) -> Float32Array:
    """Return the filled share of a disc about each pixel of a picture (h, w); outside the picture nothing is filled.

    ``disc`` (2 r + 1, 2 r + 1) is symmetric and flat inside: the flat part of each of its rows costs one
    difference of running sums, whatever its length, so that only its rim is multiplied.
    """
    h, w = membership.shape
    r = disc.shape[0] // 2
    # as wide as the picture and the disc's half on both sides; sums[k] is that of all before k
    rows, sums = np.zeros((h, w + 2 * r), np.float32), np.zeros((h, w + 2 * r + 1), np.float32)
    empty = np.ones(h, np.bool_)
    for i in range(h):
        total = np.float32(0)
        for j in range(w):
            total += membership[i, j]
            rows[i, j + r] = membership[i, j]
            sums[i, j + r + 1] = total
        sums[i, w + r + 1 :] = total
        empty[i] = total == np.float32(0)
    flat, share = disc[r, r], np.zeros((h, w), np.float32)
    for k in range(2 * r + 1):
        weights = disc[k]
        inner = r + 1
        while inner > 0 and weights[r + inner - 1] != flat:
            inner -= 1
        for i in range(max(r - k, 0), min(h + r - k, h)):
            if empty[i + k - r]:
                continue
            row, running, out = rows[i + k - r], sums[i + k - r], share[i]
            if inner > 0:
                right, left = running[r + inner :], running[r - inner + 1 :]
                for j in range(w):
                    out[j] += flat * (right[j] - left[j])
            for e in range(inner, r + 1):
                weight = weights[r + e]
                if weight == np.float32(0):
                    continue
                right, left = row[r + e :], row[r - e :]
                if e == 0:
                    weight *= np.float32(0.5)
                for j in range(w):
                    out[j] += weight * (right[j] + left[j])
    return share


@njit(cache=True, nogil=True, fastmath=True)
def _less(rise: Float32Array, response: Float32Array, dx: float, dy: float, weight: float) -> None:
    """Take the response, shifted by (dx, dy) and ``weight`` times, from ``rise``; it is nothing outside."""
    h, w = response.shape
    ix, iy = math.floor(dx), math.floor(dy)
    fx, fy, one = np.float32(dx - ix), np.float32(dy - iy), np.float32(1)
    gain = np.float32(weight)
    w00, w01 = gain * (one - fx) * (one - fy), gain * fx * (one - fy)
    w10, w11 = gain * (one - fx) * fy, gain * fx * fy
    # four whole shifts: the inner loop has no condition, so that the compiler works on many pixels at a time
    for down, right, share in ((0, 0, w00), (0, 1, w01), (1, 0, w10), (1, 1, w11)):
        x, y = ix + right, iy + down
        first, last = max(-x, 0), min(w - x, w)
        for i in range(max(-y, 0), min(h - y, h)):
            # rows cut to size: an index that might be below zero would keep the compiler from that
            out, row = rise[i, first:last], response[i + y, first + x : last + x]
            for j in range(last - first):
                out[j] -= share * row[j]


@njit(cache=True, nogil=True, fastmath=True)
def _wing_angle(membership: Float32Array) -> float:
    """Return the direction of the silhouette's long axis, 0 where that is too steep to be a wing."""
    h, w = membership.shape
    mass, x, y, xx, xy, yy = 1e-12, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(h):
        of_row, along, square = 0.0, 0.0, 0.0
        for j in range(w):
            m = float(membership[i, j])
            of_row += m
            along += m * j
            square += m * (j * j)
        mass += of_row
        x += along
        y += of_row * i
        xx += square
        xy += along * i
        yy += of_row * (i * i)
    spread = 2.0 * (xy - x * y / mass)
    angle = 0.5 * math.atan2(spread, (xx - x * x / mass) - (yy - y * y / mass))
    return angle if abs(angle) < _MAX_ROLL_RAD else 0.0


@njit(cache=True, nogil=True, fastmath=True)
def _highest(values: Float32Array) -> Float32Array:
    """Return the highest of each row."""
    highest = np.empty(values.shape[0], np.float32)
    for i in range(values.shape[0]):
        row, most = values[i], values[i, 0]
        for j in range(row.size):
            most = max(most, row[j])
        highest[i] = most
    return highest


@njit(cache=True, nogil=True)
def _summit(response: Float32Array, membership: Float32Array, aside: float) -> FloatArray:
    """Return the centre (2,) of the pixels close to the highest response less its flanks ``aside`` along the wing."""
    h, w = response.shape
    angle = _wing_angle(membership)
    dx, dy = aside * math.cos(angle), aside * math.sin(angle)
    rise = response.copy()
    _less(rise, response, dx, dy, 0.5 * _FLANK_WEIGHT)
    _less(rise, response, -dx, -dy, 0.5 * _FLANK_WEIGHT)
    # the row's highest first: most rows are far below it, and no pixel of theirs counts
    highest_of_row = _highest(rise)
    limit = 0.8 * highest_of_row.max()
    total, x, y = 1e-12, 0.0, 0.0
    for i in range(h):
        if highest_of_row[i] <= limit:
            continue
        for j in range(w):
            above = rise[i, j] - limit
            if above > 0.0:
                total += above * above
                x += above * above * j
                y += above * above * i
    return np.array([x / total, y / total])


@njit(cache=True, nogil=True)
def _fullest(membership: Float32Array, disc: Float32Array, aside: float) -> FloatArray:
    """Return where ``disc`` is filled best and its flanks, ``aside`` along the wing, are not, (2,)."""
    return _summit(filled_share(membership, disc), membership, aside)
