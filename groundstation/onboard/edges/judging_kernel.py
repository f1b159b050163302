"""Compiled arithmetic of one layout's marks: what they are free to fit, and how they vary along the edges."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, MaskArray
from groundstation.onboard.edges.layout_kernel import mark_trend

# excess that a mark may have where it would be darker than what it lies on
_ABSENT = 1e-4


class MarkFreedom(NamedTuple):
    """How free a mark's excess is: limits (2,) of line and lamps, the least, and their floor.

    ``weight`` is how much of a value's likelihood counts.
    """

    most: FloatArray
    least: float
    floor: float
    weight: float


class MarkVariation(NamedTuple):
    """Sums over rows: the variance in a mark, that elsewhere, the square of its mean excess; and the number of rows."""

    own: float
    usual: float
    square: float
    rows: float


@njit(cache=True, nogil=True)
def usual_noise(misfit: FloatArray, freedom: FloatArray, picked: NDArray[np.int64]) -> float:
    """Return the median over blocks of a pixel's variance: ``misfit`` (2, blocks, trials), the others (2, blocks)."""
    blocks = misfit.shape[1]
    own = np.empty(2 * blocks)
    for line in range(2):
        for k in range(blocks):
            own[line * blocks + k] = misfit[line, k, picked[line, k]] / max(freedom[line, k], 1.0)
    return float(np.median(own))


@njit(cache=True, nogil=True)
def judge(
    misfit: FloatArray,
    levels: FloatArray,
    known: FloatArray,
    freedom: FloatArray,
    picked: NDArray[np.int64],
    free: MarkFreedom,
    out: FloatArray,
) -> None:
    """Fill the misfits (2, blocks, trials) with what a layout's marks are free to fit.

    ``levels`` (2, blocks, trials, 4, 3), ``known`` (2, bars, blocks, trials) of `bar_information`, ``freedom`` and
    ``picked`` (2, blocks).
    """
    blocks, trials = misfit.shape[1], misfit.shape[2]
    noise = max(usual_noise(misfit, freedom, picked), 1e-9)
    nats, trend = np.zeros((2, blocks, trials)), np.empty((blocks, 3))
    excess, there = np.empty((2, blocks, 3)), np.empty((2, blocks))
    out[:] = misfit
    for bar in range(2):
        if not known[:, bar].any():
            continue
        for line in range(2):
            for k in range(blocks):
                excess[line, k] = levels[line, k, picked[line, k], 2 + bar]
                there[line, k] = known[line, bar, k, picked[line, k]]
        seen = mark_trend(excess, there, trend)
        for k in range(blocks):
            strength = abs(trend[k, 0]) / math.sqrt(3.0)
            spread = min(max(seen, free.least * strength), free.most[bar] * strength)
            stiffness = noise / (free.floor**2 + spread**2)
            if trend[k, 0] < 0.0:
                # paint and light are not darker than what they lie on: then there is no mark, and what remains is left
                trend[k] = 0.0
                stiffness = noise / _ABSENT**2
            for line in range(2):
                for o in range(trials):
                    information = known[line, bar, k, o]
                    off = 0.0
                    for c in range(3):
                        off += (levels[line, k, o, 2 + bar, c] - trend[k, c]) ** 2
                    out[line, k, o] += information * stiffness / (information + stiffness) * off
                    nats[line, k, o] += 1.5 * free.weight * math.log1p(information / stiffness)
    for line in range(2):
        for k in range(blocks):
            power = max(0.5 * free.weight * freedom[line, k], 1e-9)
            for o in range(trials):
                out[line, k, o] *= math.exp(nats[line, k, o] / power)


@njit(cache=True, nogil=True)
def sum_variation(
    total: FloatArray,
    weight: FloatArray,
    squares: FloatArray,
    bars: FloatArray,
    moved: FloatArray,
    level: FloatArray,
    near: MaskArray,
) -> MarkVariation:
    """Return how a mark varies along the edges in the blocks that are near.

    ``bars`` (2, blocks, 2) its sides in bins, displaced by ``moved`` (2, blocks) bins; ``level`` (2, blocks) its mean
    excess; the others are those of `gather`.
    """
    blocks, bins = weight.shape[1], weight.shape[2]
    varied = np.empty(bins)
    own, usual, square, rows = 0.0, 0.0, 0.0, 0.0
    for line in range(2):
        for k in range(blocks):
            if not near[k]:
                continue
            inner = bars[line, k, 0] + bins // 2 + moved[line, k]
            outer = bars[line, k, 1] + bins // 2 + moved[line, k]
            first = max(round(inner), 0)
            last = min(max(round(outer), round(inner) + 1), bins)
            if last <= first or weight[line, k, first:last].min() <= 0.0:
                continue
            count, seen = weight[line, k, first:last].mean(), 0
            for i in range(bins):
                w = max(weight[line, k, i], 1e-9)
                mean = (total[line, k, i, 0] + total[line, k, i, 1] + total[line, k, i, 2]) / max(3.0 * w, 1e-9)
                variance = max(squares[line, k, i] / w - mean**2, 0.0)
                if first <= i < last:
                    own += count * variance / (last - first)
                if weight[line, k, i] > 0.0:
                    varied[seen] = variance
                    seen += 1
            usual += count * float(np.median(varied[:seen]))
            square += count * level[line, k] ** 2
            rows += count
    return MarkVariation(own, usual, square, rows)
