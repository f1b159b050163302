"""Compiled arithmetic of what tells layouts apart: how well a bar's excess is known, and how it varies along it."""

import math

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.profile_kernel import fill_bar, fill_steps

_SQUARE = 1e-9  # of a level that nothing measures


@njit(cache=True, nogil=True)
def bar_information(weight: FloatArray, blurs: FloatArray, bars: FloatArray, trials: int, out: FloatArray) -> None:
    """Fill how much the bins know of each bar's excess, pavement and ground being unknown, in pixels.

    ``out`` (layouts, bars, blocks, trials); `misfits` has the other arguments. Of two bars each is taken as alone.
    """
    blocks, bins = weight.shape
    layouts, count, middle = bars.shape[0], bars.shape[1], trials // 2
    origin = bins // 2 + middle
    steps, shape = np.empty((2, bins + trials)), np.empty(bins + trials)
    limits = np.empty(2, np.int64)
    for k in range(blocks):
        fill_steps(steps, blurs[k], origin)
        common = np.zeros((trials, 3))
        for o in range(trials):
            for i in range(bins):
                a, b = steps[0, i + 2 * middle - o], steps[1, i + 2 * middle - o]
                common[o, 0] += weight[k, i] * a * a
                common[o, 1] += weight[k, i] * a * b
                common[o, 2] += weight[k, i] * b * b
        for n in range(layouts):
            for m in range(count):
                fill_bar(shape, bars[n, m, k, 0], bars[n, m, k, 1], blurs[k], origin, limits)
                for o in range(trials):
                    shift, own, a, b = 2 * middle - o, 0.0, 0.0, 0.0
                    for i in range(max(limits[0] - shift, 0), min(limits[1] - shift, bins)):
                        value = weight[k, i] * shape[i + shift]
                        own += value * shape[i + shift]
                        a += value * steps[0, i + shift]
                        b += value * steps[1, i + shift]
                    aa, ab, bb = common[o, 0] + _SQUARE, common[o, 1], common[o, 2] + _SQUARE
                    known = (a * a * bb - 2.0 * a * b * ab + b * b * aa) / max(aa * bb - ab * ab, _SQUARE)
                    out[n, m, k, o] = max(own - known, 0.0)


@njit(cache=True, nogil=True)
def _between(curve: FloatArray, place: float) -> float:
    """Return a curve (n,) between its values, by cubic interpolation."""
    i = min(max(int(place), 1), curve.size - 3)
    f = place - i
    a, b, c, d = curve[i - 1], curve[i], curve[i + 1], curve[i + 2]
    return b + 0.5 * f * (c - a + f * (2.0 * a - 5.0 * b + 4.0 * c - d + f * (3.0 * (b - c) + d - a)))


@njit(cache=True, nogil=True)
def line_evidence(
    misfit: FloatArray, least: FloatArray, power: FloatArray, outlier: float, steps: FloatArray, up: float, low: float
) -> float:
    """Return a line's log-likelihood displaced by ``up`` and ``low`` px, as in `line_likelihood`, between its trials.

    ``misfit`` (blocks, trials); ``least`` and ``power`` (blocks,).
    """
    blocks, trials = misfit.shape
    whole = 0.0
    for k in range(blocks):
        t = (k + 0.5) / blocks
        place = (up * (1.0 - t) + low * t) / (steps[0] * (1.0 - t) + steps[1] * t) + trials // 2
        own = max(_between(misfit[k], min(max(place, 0.0), trials - 1.0)), 0.5 * least[k])
        whole += math.log(math.exp(power[k] * math.log(least[k] / own)) + outlier)
    return whole


# a displacement is made finer in so many parts of a step, to either side, in at most so many turns of both lines
_PARTS, _TURNS = 4, 6


@njit(cache=True, nogil=True)
def refine_displacement(
    misfit: FloatArray,
    least: FloatArray,
    power: FloatArray,
    outlier: float,
    steps: FloatArray,
    offset: FloatArray,
    weight: FloatArray,
    moved: FloatArray,
) -> float:
    """Make the displacement (4,) px of both lines finer than the trials', in place; returns its log-likelihood.

    ``misfit`` (2, blocks, trials), ``least`` and ``power`` (2, blocks); the prior's mean ``offset`` (4,), inverse
    covariance ``weight`` (4, 4).
    """
    start, r, trial = moved.copy(), np.empty(4), np.empty(4)
    own = np.empty((2, 2 * _PARTS + 1, 2 * _PARTS + 1))
    for line in range(2):
        for a in range(2 * _PARTS + 1):
            for b in range(2 * _PARTS + 1):
                own[line, a, b] = line_evidence(
                    misfit[line], least[line], power[line], outlier, steps,
                    start[2 * line] + steps[0] * (a - _PARTS) / _PARTS,
                    start[2 * line + 1] + steps[1] * (b - _PARTS) / _PARTS,
                )  # fmt: skip
    at = np.full((2, 2), _PARTS)
    highest = -np.inf
    for turn in range(_TURNS):
        line = turn % 2
        before = highest
        for a in range(2 * _PARTS + 1):
            for b in range(2 * _PARTS + 1):
                trial[:] = moved
                trial[2 * line] = start[2 * line] + steps[0] * (a - _PARTS) / _PARTS
                trial[2 * line + 1] = start[2 * line + 1] + steps[1] * (b - _PARTS) / _PARTS
                whole = own[line, a, b] + own[1 - line, at[1 - line, 0], at[1 - line, 1]]
                for i in range(4):
                    r[i] = trial[i] - offset[i]
                for i in range(4):
                    for j in range(4):
                        whole -= 0.5 * r[i] * weight[i, j] * r[j]
                if whole > highest:
                    highest = whole
                    at[line, 0], at[line, 1] = a, b
        moved[2 * line] = start[2 * line] + steps[0] * (at[line, 0] - _PARTS) / _PARTS
        moved[2 * line + 1] = start[2 * line + 1] + steps[1] * (at[line, 1] - _PARTS) / _PARTS
        if turn > 0 and highest <= before:
            break
    return highest


@njit(cache=True, nogil=True)
def mark_trend(excess: FloatArray, known: FloatArray, out: FloatArray) -> float:
    """Fill the straight trend (blocks, 3) of both edges' excess (2, blocks, 3) of a mark, robustly.

    ``known`` (2, blocks) are weights. Returns the root mean square of what is off it, over the three together.
    """
    blocks = out.shape[0]
    grey = excess[:, :, 0].copy()
    middle = np.median(grey)
    away = np.median(np.abs(grey - middle))
    w, wt, wtt = 1e-12, 0.0, 0.0
    y, ty = np.zeros(3), np.zeros(3)
    for line in range(2):
        for k in range(blocks):
            t = 2.0 * k / (blocks - 1) - 1.0
            own = (known[line, k] + 1e-9) / (1.0 + ((grey[line, k] - middle) / (2.0 * away + 1e-6)) ** 2)
            w += own
            wt += own * t
            wtt += own * t * t
            for c in range(3):
                y[c] += own * excess[line, k, c]
                ty[c] += own * t * excess[line, k, c]
    # the slope is known to be small: haze takes a part of the contrast along the edge
    wtt += 0.1 * w
    determinant = w * wtt - wt * wt
    off = 0.0
    for c in range(3):
        level, slope = (wtt * y[c] - wt * ty[c]) / determinant, (w * ty[c] - wt * y[c]) / determinant
        for k in range(blocks):
            out[k, c] = level + slope * (2.0 * k / (blocks - 1) - 1.0)
            for line in range(2):
                off += (excess[line, k, c] - out[k, c]) ** 2
    return math.sqrt(off / (6.0 * blocks))
