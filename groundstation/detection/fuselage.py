"""The fuselage of a silhouette rotated level: its middle row by row, its ends, and the nose that they imply.

The nose follows from the appearance of a typical fuselage at each attitude: a grid of attitudes around
the flight direction is weighted by its fit to the outline, and the implied noses are averaged.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray

Float32Array = NDArray[np.float32]
IndexArray = NDArray[np.int64]

# half widths and heights above and below the nose's centre, at distances behind it, all in spans
_BEHIND = np.array([0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7])
_HALF_WIDTH = np.array([0.012, 0.027, 0.034, 0.040, 0.044, 0.045, 0.045, 0.045, 0.044, 0.042, 0.030, 0.024, 0.018])
_ABOVE = np.array([0.012, 0.027, 0.034, 0.042, 0.055, 0.068, 0.080, 0.090, 0.086, 0.080, 0.050, 0.035, 0.025])
_BELOW = np.array([0.012, 0.027, 0.034, 0.040, 0.046, 0.050, 0.053, 0.053, 0.052, 0.050, 0.038, 0.028, 0.020])
_SIGMA = np.array([0.006, 0.007, 0.008, 0.010, 0.012, 0.014, 0.014, 0.014, 0.014, 0.014, 0.014, 0.014, 0.014])
_LENGTH_SIGMA = 0.12  # of the distance behind the nose
_WING_BEHIND = 0.27
_WING_BEHIND_SIGMA = 0.05
_THICKEST_BEHIND, _THICKEST_BEHIND_SIGMA = 0.3, 0.12  # the nose
_THICKEST_BELOW, _THICKEST_SIGMA = 0.005, 0.012  # at no pitch: the cabin above, less the gear below
_ENDS_LEGIBLE_PX = 60.0  # a span from which the outline's ends are more informative
_CORE = 0.032  # half width of what counts as fuselage
_WIDEST = 0.1  # half width beyond which a row holds more than the fuselage
_FILLED = 0.75  # of the core's width: the leg of a nose wheel fills less
_ASIDE = 0.07
_GAP = 0.04  # rows may be missing between body and wing
_ROW_SHAPE = 0.0042
_USUAL_WIDTH, _EXCESS_SHARE = 0.105, 0.35
_WIDER_SIGMA, _NARROWER_SIGMA = 0.06, 0.015
_WIDTHS_COUNT = 1.0
_GRID = 11
_GRID_SIGMAS = 2.5


@njit(cache=True, nogil=True)
def _edge(level: Float32Array, i: int, start: int, step: int, reach: float) -> float:
    """Return where row i falls below one half, walking from ``start``; NaN beyond ``reach``."""
    w = level.shape[1]
    j = start
    while 0 <= j + step < w and level[i, j + step] >= 0.5:
        j += step
        if abs(j - start) > reach:
            return math.nan
    if not 0 <= j + step < w:
        return float(j)
    inner, outer = level[i, j], level[i, j + step]
    return j + step * (inner - 0.5) / max(inner - outer, 1e-6)


@njit(cache=True, nogil=True)
def _core(level: Float32Array, i: int, middle: float, half: float) -> float:
    """Return the mean membership of row i within ``half`` of the middle."""
    w = level.shape[1]
    a, b = max(int(middle - half + 0.5), 0), min(int(middle + half + 0.5), w - 1)
    total = 0.0
    for j in range(a, b + 1):
        total += level[i, j]
    return total / max(b - a + 1, 1)


@njit(cache=True, nogil=True)
def _aside(level: Float32Array, i: int, middle: float, half: float, reach: float) -> float:
    """Return the place of row i within ``reach`` of the middle that is filled, the middle itself if none is."""
    for k in range(1, int(reach) + 1):
        for sign in (-1.0, 1.0):
            if _core(level, i, middle + sign * k, half) >= _FILLED:
                return middle + sign * k
    return middle


@njit(cache=True, nogil=True)
def _follow(
    level: Float32Array, s0: float, t0: int, step: int, band: tuple[float, float], span: float, found: FloatArray
) -> float:
    """Walk from row t0 up or down along the fuselage, note the rows' middles, return where its core ends."""
    h, w = level.shape
    half, widest = max(_CORE * span, 0.5), 2.0 * _WIDEST * span + 1.0
    gap = max(_GAP * span, 1.0)
    middle, last = s0, float(t0)
    i = t0
    end = float(t0)
    while 0 <= i < h:
        core = _core(level, i, middle, half)
        if core < _FILLED and last == i - step and band[0] - 3.0 <= i <= band[1] + 3.0:
            # beyond the wing the body may be to one side of the line followed
            middle = _aside(level, i, middle, half, _ASIDE * span)
            core = _core(level, i, middle, half)
        if core >= _FILLED:
            last = float(i)
            end = i + 0.5 * step
            if 0 <= i + step < h:
                after = _core(level, i + step, middle, half)
                if after < _FILLED:
                    end = i + step * (core - _FILLED) / max(core - after, 1e-6)
            if not band[0] - 1.5 <= i <= band[1] + 1.5:
                start = min(max(int(middle + 0.5), 0), w - 1)
                if level[i, start] >= 0.5:
                    left, right = _edge(level, i, start, -1, widest), _edge(level, i, start, 1, widest)
                    if half <= right - left <= widest:
                        found[i, 0], found[i, 1] = 0.5 * (left + right), right - left
                        middle += 0.5 * (found[i, 0] - middle)
        elif abs(i - last) > gap:
            break
        i += step
    return end


@njit(cache=True, nogil=True)
def trace(
    level: Float32Array, start: tuple[float, float], band: tuple[float, float], span: float
) -> tuple[FloatArray, tuple[float, float]]:
    """Follow the fuselage both ways from a place s, t inside it; ``band`` holds the wing's rows.

    Returns t, middle and width of its rows (n, 3), and the rows where its core ends above and below.
    """
    h, w = level.shape
    found = np.full((h, 2), np.nan)
    t0 = min(max(round(start[1]), 0), h - 1)
    s0 = min(max(start[0], 0.0), w - 1.0)
    bottom = _follow(level, s0, t0, 1, band, span, found)
    top = _follow(level, s0, t0, -1, band, span, found)
    rows = np.empty((h, 3))
    n = 0
    for i in range(h):
        if not math.isnan(found[i, 0]):
            rows[n, 0], rows[n, 1], rows[n, 2] = i, found[i, 0], found[i, 1]
            n += 1
    return rows[:n], (top, bottom)


@njit(cache=True, nogil=True)
def _end(
    forward_t: float, heights: FloatArray, sign: float, span: float, sections: FloatArray, sigmas: FloatArray
) -> tuple[float, float]:
    """Return how far above (−1) or below (+1) the nose the outline ends, in px, and its sigma."""
    best, spread = -1e9, 1.0
    for k in range(sections.size):
        reach = -sign * sections[k] * forward_t + heights[k] * span
        if reach > best:
            best = reach
            spread = math.hypot(sigmas[k] * span, _LENGTH_SIGMA * sections[k] * forward_t)
    return best, spread


@njit(cache=True, nogil=True)
def _cut_by(
    t: float, forward_t: float, span: float, sections: FloatArray, above: FloatArray, below: FloatArray, cut: IndexArray
) -> int:
    """Write which sections a row ``t`` below the nose cuts; returns how many."""
    n = 0
    for k in range(sections.size):
        centre = -sections[k] * forward_t
        if centre - above[k] * span <= t <= centre + below[k] * span:
            cut[n] = k
            n += 1
    return n


@njit(cache=True, nogil=True)
def _row_extent(
    cut: IndexArray, forward_s: float, span: float, sections: FloatArray, widths: FloatArray
) -> tuple[float, float]:
    """Return middle and width, relative to the nose, of the sections that a row cuts."""
    left, right = 1e9, -1e9
    for k in cut:
        left = min(left, -sections[k] * forward_s - widths[k] * span)
        right = max(right, -sections[k] * forward_s + widths[k] * span)
    return 0.5 * (left + right), right - left


@njit(cache=True, nogil=True)
def _nose_from_ends(
    ends: tuple[float, float], thickest: float, forward_t: float, z_t: float, scale: tuple[float, float]
) -> tuple[float, float, float]:
    """Return the nose along the picture's vertical from both ends and the thickest place, its variance and its χ²."""
    span, edge = scale
    up, up_sigma = _end(forward_t, _ABOVE, -1.0, span, _BEHIND, _SIGMA)
    down, down_sigma = _end(forward_t, _BELOW, 1.0, span, _BEHIND, _SIGMA)
    v_top, v_bottom = up_sigma**2 + edge**2, down_sigma**2 + edge**2
    from_top, from_bottom = ends[0] + up, ends[1] - down
    # the thickest place is detected more reliably, but which part of the body it is depends on the view
    from_thickest = thickest + _THICKEST_BEHIND * forward_t - _THICKEST_BELOW * span
    v_thickest = (_THICKEST_SIGMA * span) ** 2 + (_THICKEST_BEHIND_SIGMA * forward_t) ** 2 + edge**2
    v_thickest *= max(span / _ENDS_LEGIBLE_PX, 1.0) ** 4
    total_t = 1.0 / v_top + 1.0 / v_bottom + 1.0 / v_thickest
    nose_t = (from_top / v_top + from_bottom / v_bottom + from_thickest / v_thickest) / total_t
    chi_t = (from_top - nose_t) ** 2 / v_top + (from_bottom - nose_t) ** 2 / v_bottom
    chi_t += (from_thickest - nose_t) ** 2 / v_thickest + z_t * z_t
    return nose_t, 1.0 / total_t, chi_t


@njit(cache=True, nogil=True)
def _weigh(
    rows: FloatArray,
    row_weights: FloatArray,
    ends: tuple[float, float],
    wing: tuple[float, float],
    thickest: float,
    forward: tuple[float, float],
    sigma: tuple[float, float],
    scale: tuple[float, float],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the nose of each attitude of the grid (n, 2), its variances (n, 2) and its χ² (n,)."""
    sections, widths, above, below = _BEHIND, _HALF_WIDTH, _ABOVE, _BELOW
    span = scale[0]
    count = _GRID * _GRID
    noses, variances, chi = np.empty((count, 2)), np.empty((count, 2)), np.empty(count)
    cut, cuts = np.empty((rows.shape[0], sections.size), np.int64), np.empty(rows.shape[0], np.int64)
    for a in range(_GRID):
        z_t = _GRID_SIGMAS * (2.0 * a / (_GRID - 1) - 1.0)
        forward_t = forward[1] + z_t * sigma[1]
        nose_t, var_t, chi_t = _nose_from_ends(ends, thickest, forward_t, z_t, scale)
        # the same for every turn to the side
        for k in range(rows.shape[0]):
            cuts[k] = _cut_by(rows[k, 0] - nose_t, forward_t, span, sections, above, below, cut[k])
        for b in range(_GRID):
            z_s = _GRID_SIGMAS * (2.0 * b / (_GRID - 1) - 1.0)
            forward_s = forward[0] + z_s * sigma[0]
            v_wing = wing[1] ** 2 + (_WING_BEHIND_SIGMA * forward_s) ** 2
            weight = 1.0 / v_wing
            total = weight * (wing[0] + _WING_BEHIND * forward_s)
            square = weight * (wing[0] + _WING_BEHIND * forward_s) ** 2
            widths_chi = 0.0
            for k in range(rows.shape[0]):
                shift, width = _row_extent(cut[k, : cuts[k]], forward_s, span, sections, widths)
                if width > 0.0:
                    value = rows[k, 1] - shift
                    off = (rows[k, 2] - width) / span
                    off /= _WIDER_SIGMA if off > 0 else _NARROWER_SIGMA
                    widths_chi += min(off * off, 4.0)
                    total += value * row_weights[k]
                    square += value * value * row_weights[k]
                    weight += row_weights[k]
            n = a * _GRID + b
            mean = total / weight
            noses[n, 0], noses[n, 1] = mean, nose_t
            variances[n, 0], variances[n, 1] = 1.0 / weight, var_t
            chi[n] = (
                chi_t
                + max(square - weight * mean * mean, 0.0)
                + z_s * z_s
                + widths_chi / max(rows.shape[0] / _WIDTHS_COUNT, 1.0)
            )
    return noses, variances, chi


@njit(cache=True, nogil=True)
def _row_weights(widths: FloatArray, scale: tuple[float, float]) -> FloatArray:
    """Return the inverse variances of the rows' middles, (n,)."""
    span, edge = scale
    weights = np.empty(widths.size)
    # errors of neighbouring rows are correlated; a row that is too wide has gear or struts on one of its sides
    alike = min(max(widths.size / 3.0, 1.0), 3.0)
    for k in range(widths.size):
        excess = max(widths[k] - _USUAL_WIDTH * span - 1.0, 0.0)
        weights[k] = 1.0 / (alike * (edge**2 + (_ROW_SHAPE * span) ** 2 + (_EXCESS_SHARE * excess) ** 2))
    return weights


@njit(cache=True, nogil=True)
def _average(noses: FloatArray, variances: FloatArray, chi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean (2,) and covariance (2, 2) of noses (n, 2) with variances (n, 2), weighed by their χ² (n,)."""
    weight = np.exp(-0.5 * (chi - chi.min()))
    weight /= weight.sum()
    mean, covariance = np.zeros(2), np.zeros((2, 2))
    for k in range(weight.size):
        mean[0] += weight[k] * noses[k, 0]
        mean[1] += weight[k] * noses[k, 1]
    for k in range(weight.size):
        s, t = noses[k, 0] - mean[0], noses[k, 1] - mean[1]
        covariance[0, 0] += weight[k] * (s * s + variances[k, 0])
        covariance[0, 1] += weight[k] * s * t
        covariance[1, 1] += weight[k] * (t * t + variances[k, 1])
    covariance[1, 0] = covariance[0, 1]
    return mean, covariance


@njit(cache=True, nogil=True)
def locate_nose(
    rows: FloatArray,
    ends: tuple[float, float],
    wing_middle: tuple[float, float],
    thickest: float,
    forward: tuple[float, float],
    sigma: tuple[float, float],
    scale: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return the nose (2,) in s, t and its covariance (2, 2).

    Parameters
    ----------
    rows, ends : the fuselage as traced.
    wing_middle : place along s of the wing's middle, px, and its sigma.
    thickest : place along t, px, where the silhouette holds the widest disc.
    forward : image shift in px of one span's length along the expected body axis; ``sigma`` per component.
    scale : the span in px, and the sigma of an edge's place in px.
    """
    weights = _row_weights(rows[:, 2], scale)
    noses, variances, chi = _weigh(rows, weights, ends, wing_middle, thickest, forward, sigma, scale)
    return _average(noses, variances, chi)
