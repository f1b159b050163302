"""The wing of a silhouette: its line, its tips, and the picture turned so that it lies level.

In the turned picture s runs along the wing to the right and t across it downwards.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray

Float32Array = NDArray[np.float32]

_OUTER = 0.22  # of the width: farther from the middle there is nothing but wing
_MAX_ROLL_RAD = math.radians(35.0)
_LEAST_COLUMNS = 5
_FAINT = 0.1
_WING_QUANTILE = 0.7
_LEAST_MASS = 0.25  # px in a column
_MAX_SCATTER = 0.05
_FLOOR = 0.7  # px


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wing:
    """A silhouette turned level.

    ``level`` (h, w) float32 is the membership, ``tips`` (left, right) and ``band`` (top, bottom) bound the wing
    in it; ``seen`` is False where no wing line could be fitted. ``rotation`` and ``offset`` lead back:
    working px = rotation @ (s, t) + offset.
    """

    level: Float32Array
    tips: tuple[float, float]
    band: tuple[float, float]
    seen: bool
    rotation: FloatArray
    offset: FloatArray

    def level_point(self, point: FloatArray) -> FloatArray:
        """Map a working pixel (2,) to s, t."""
        return np.asarray(self.rotation.T @ (point - self.offset), np.float64)

    def working_point(self, point: FloatArray) -> FloatArray:
        """Map s, t (2,) to the working pixel."""
        return np.asarray(self.rotation @ point + self.offset, np.float64)


@njit(cache=True, nogil=True)
def _line(membership: Float32Array, middle: float, reach: float) -> tuple[float, float, int]:
    """Return slope, scatter and number of a robust line through the centroids of columns beyond ``reach``."""
    h, w = membership.shape
    u, v, weight = np.empty(w), np.empty(w), np.empty(w)
    n = 0
    for j in range(w):
        mass, moment = 0.0, 0.0
        for i in range(h):
            mass += membership[i, j]
            moment += membership[i, j] * i
        if mass > _LEAST_MASS and abs(j - middle) > reach:
            u[n], v[n], weight[n] = j - middle, moment / mass, min(mass, 3.0)
            n += 1
    if n < 3:
        return 0.0, 1e9, n
    slope, level, scatter = 0.0, 0.0, 1e9
    for turn in range(5):
        sw, su, sv, suu, suv = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(n):
            q = weight[k]
            if turn > 0:
                q /= 1.0 + ((v[k] - level - slope * u[k]) / max(scatter, _FLOOR)) ** 2
            sw += q
            su += q * u[k]
            sv += q * v[k]
            suu += q * u[k] * u[k]
            suv += q * u[k] * v[k]
        determinant = sw * suu - su * su
        if determinant <= 1e-9:
            return 0.0, 1e9, n
        slope = (sw * suv - su * sv) / determinant
        level = (sv - slope * su) / sw
        total = 0.0
        for k in range(n):
            total += min(abs(v[k] - level - slope * u[k]), 3.0 * scatter)
        scatter = total / n
    return slope, scatter, n


@njit(cache=True, nogil=True)
def _crossing(profile: FloatArray, level: float, start: int, step: int) -> float:
    """Return where the profile first rises above a level, walking inwards from an end."""
    k, n = start, profile.size
    while 0 <= k < n and profile[k] < level:
        k += step
    if not 0 <= k < n:
        return float(start)
    if not 0 <= k - step < n:
        return float(k) - 0.5 * step
    below = profile[k - step]
    return k - step * (profile[k] - level) / max(profile[k] - below, 1e-6)


def find_wing(membership: Float32Array, body: FloatArray, span: float) -> Wing:
    """Fit the wing's line to both sides of the body (2,) and turn the silhouette level."""
    slope, scatter, columns = _line(membership, float(body[0]), _OUTER * span)
    h, w = membership.shape
    seen = columns >= _LEAST_COLUMNS and scatter < max(_MAX_SCATTER * span, 1.0)
    angle = math.atan(slope) if seen and abs(slope) < math.tan(_MAX_ROLL_RAD) else 0.0
    seen = seen and abs(slope) < math.tan(_MAX_ROLL_RAD)
    cos, sin = math.cos(angle), math.sin(angle)
    size = (math.ceil(w * cos + h * abs(sin)) + 1, math.ceil(h * cos + w * abs(sin)) + 1)
    rotation = np.array([[cos, -sin], [sin, cos]])
    offset = 0.5 * np.array([w - 1.0, h - 1.0]) - rotation @ (0.5 * np.array([size[0] - 1.0, size[1] - 1.0]))
    transform = np.concatenate([rotation, offset[:, None]], axis=1)
    level = np.asarray(
        cv2.warpAffine(membership, transform, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP), np.float32
    )
    tips, band = _extent(level, float((rotation.T @ (body - offset))[0]), _OUTER * span)
    return Wing(level=level, tips=tips, band=band, seen=seen, rotation=rotation, offset=offset)


@njit(cache=True, nogil=True)
def _extent(level: Float32Array, middle: float, reach: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the wing's tips along s and its rows along t."""
    h, w = level.shape
    first, last = max(int(middle - reach), 0), math.ceil(middle + reach) + 1
    rows = np.zeros(h)
    seen = False
    for i in range(h):
        for j in range(w):
            seen |= level[i, j] > _FAINT
            if j < first or j >= last:
                rows[i] += level[i, j]
    if not seen:
        return (0.0, w - 1.0), (0.0, 0.0)
    half = 0.4 * rows.max()
    peak = int(rows.argmax())
    top = _crossing(-rows[: peak + 1][::-1], -half, 0, 1)
    bottom = _crossing(-rows[peak:], -half, 0, 1)
    t0, t1 = peak - top, peak + bottom
    profile = np.zeros(w)
    for i in range(max(int(t0) - 1, 0), min(math.ceil(t1) + 2, h)):
        for j in range(w):
            profile[j] = max(profile[j], level[i, j])
    # a thin wing far away never fills a pixel: half of its own level counts
    outside = np.sort(np.concatenate((profile[:first], profile[last:])))
    faint = np.searchsorted(outside, _FAINT, side="right")
    half = 0.5
    if faint < outside.size:
        place = faint + _WING_QUANTILE * (outside.size - 1 - faint)
        k = int(place)
        half = 0.5 * (outside[k] + (place - k) * (outside[min(k + 1, outside.size - 1)] - outside[k]))
    return (_crossing(profile, half, 0, 1), _crossing(profile, half, w - 1, -1)), (t0, t1)
