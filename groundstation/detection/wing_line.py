"""Wing of a silhouette: its line, its tips, and the rotation of the image that levels it.

In the rotated image s runs along the wing to the right and t across it downwards.
"""

import math

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


@njit(cache=True, nogil=True)
def _line(membership: Float32Array, middle: float, reach: float) -> tuple[float, float, int]:
    """Return slope, scatter and number of a robust line through the centroids of columns beyond ``reach``."""
    h, w = membership.shape
    u, v, weight = np.empty(w), np.empty(w), np.empty(w)
    mass, moment = np.zeros(w), np.zeros(w)
    # row by row, in memory order
    for i in range(h):
        for j in range(w):
            mass[j] += membership[i, j]
            moment[j] += membership[i, j] * i
    n = 0
    for j in range(w):
        if mass[j] > _LEAST_MASS and abs(j - middle) > reach:
            u[n], v[n], weight[n] = j - middle, moment[j] / mass[j], min(mass[j], 3.0)
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


@njit(cache=True, nogil=True)
def level_frame(membership: Float32Array, body_s: float, span: float) -> tuple[FloatArray, tuple[int, int], bool]:
    """Fit the wing's line to both sides of the body and return how to turn the silhouette level.

    Parameters
    ----------
    membership : (h, w) of the silhouette, in [0, 1].
    body_s : the column in which the body stands.
    span : px.

    Returns
    -------
    (2, 3) rotation and offset that lead from s, t, 1 back to a pixel, the width and height of the turned picture, and
    whether a wing's line could be fitted.
    """
    slope, scatter, columns = _line(membership, body_s, _OUTER * span)
    h, w = membership.shape
    seen = columns >= _LEAST_COLUMNS and scatter < max(_MAX_SCATTER * span, 1.0)
    seen = seen and abs(slope) < math.tan(_MAX_ROLL_RAD)
    angle = math.atan(slope) if seen else 0.0
    cos, sin = math.cos(angle), math.sin(angle)
    size = (math.ceil(w * cos + h * abs(sin)) + 1, math.ceil(h * cos + w * abs(sin)) + 1)
    s, t = 0.5 * (size[0] - 1.0), 0.5 * (size[1] - 1.0)
    back = np.array([[cos, -sin, 0.5 * (w - 1.0)], [sin, cos, 0.5 * (h - 1.0)]])
    back[0, 2] -= cos * s - sin * t
    back[1, 2] -= sin * s + cos * t
    return back, size, seen


@njit(cache=True, nogil=True)
def extent(level: Float32Array, body_s: float, span: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the wing's tips along s and its rows along t, in a picture (h, w) that was turned level."""
    h, w = level.shape
    first, last = max(int(body_s - _OUTER * span), 0), math.ceil(body_s + _OUTER * span) + 1
    rows = np.zeros(h)
    highest = np.float32(0)
    for i in range(h):
        row = level[i]
        for j in range(w):
            highest = max(highest, row[j])
        for j in range(min(first, w)):
            rows[i] += row[j]
        for j in range(last, w):
            rows[i] += row[j]
    if highest <= _FAINT:
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
