"""Compiled arithmetic of the profile across an edge: levels by least squares, a line's likelihood."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray

_SQUARE = 1e-9  # of a level that nothing measures
# of a pixel's grey and of its tints, that a codec leaves unknown: two grey levels
QUANTUM = (2.0 / 255.0) ** 2


# the normal distribution, in steps of 1 / 32 from −4 to 4
_FROM, _PER_SIGMA = 4.0, 32.0
_NORMAL = np.array([0.5 * (1.0 + math.erf(math.sqrt(0.5) * (k / _PER_SIGMA - _FROM))) for k in range(258)])


@njit(cache=True, nogil=True, inline="always")
def _under(z: float) -> float:
    """Return the normal distribution below z, to 5e-5; a table takes a tenth of erf's time."""
    place = (min(max(z, -_FROM), _FROM) + _FROM) * _PER_SIGMA
    k = int(place)
    f = place - k
    return _NORMAL[k] * (1.0 - f) + _NORMAL[k + 1] * f


class ExcessPrior(NamedTuple):
    """Expected excess (bars, blocks, 3) of each bar over what it lies on, and its weight (bars,), in pixels."""

    excess: FloatArray
    stiffness: FloatArray


# The parts of `misfits` take arrays one by one: a named tuple of arrays costs each call 50 ns, a third of their time.
# All shapes use the bins of the widest shift; of a trial, those from ``shift`` on count.


@njit(cache=True, nogil=True)
def fill_steps(steps: FloatArray, blur: float, origin: int) -> None:
    """Fill the blurred pavement and ground (2, bins), the edge at bin ``origin``."""
    for i in range(steps.shape[1]):
        steps[1, i] = _under((i - origin) / blur)
        steps[0, i] = 1.0 - steps[1, i]


@njit(cache=True, nogil=True)
def fill_slope(slope: FloatArray, blur: float, origin: int, reach: int) -> None:
    """Fill the blurred rise (bins,) of the ground outwards from the edge at bin ``origin``, 1 after ``reach`` bins."""
    for i in range(slope.size):
        z = (i - origin) / blur
        bend = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi) if abs(z) < _FROM else 0.0
        slope[i] = blur * (z * _under(z) + bend) / reach


@njit(cache=True, nogil=True)
def fill_bar(
    shape: FloatArray, inner: float, outer: float, blur: float, origin: int, limits: NDArray[np.int64]
) -> None:
    """Fill a blurred bar (bins,) between its ``limits``: the first bin, and the one behind the last; none has none."""
    limits[0] = max(math.floor(inner - _FROM * blur) + origin, 0)
    limits[1] = min(math.ceil(outer + _FROM * blur) + origin + 1, shape.size)
    if inner == outer:
        limits[1] = limits[0]
    for i in range(limits[0], limits[1]):
        z = float(i - origin)
        shape[i] = _under((z - inner) / blur) - _under((z - outer) / blur)


# Below, trials are the last dimension of every array, so that all are worked out side by side. A signal has
# 2 · (trials // 2) zeros before it: from trial o on its bins are those that a shape meets there.


@njit(cache=True, nogil=True)
def _fill_signals(total: FloatArray, weight: FloatArray, first: int, signals: FloatArray, squares: FloatArray) -> float:
    """Fill the weights and the three colours of a block, (4, bins with zeros about them), from bin ``first`` on.

    Fills also the colours' squares (3,) over the weights (bins,); returns the sum of the weights.
    """
    whole = 0.0
    squares[:] = 0.0
    for i in range(weight.size):
        whole += weight[i]
        signals[0, first + i] = weight[i]
        for c in range(3):
            signals[1 + c, first + i] = total[i, c]
            if weight[i] > 0.0:
                squares[c] += total[i, c] ** 2 / weight[i]
    return whole


@njit(cache=True, nogil=True)
def _correlate(a: FloatArray, b: FloatArray, first: int, last: int, signal: FloatArray, out: FloatArray) -> None:
    """Fill the sums (trials,) of the product of two shapes, from bin ``first`` to before ``last``, with a signal."""
    out[:] = 0.0
    for i in range(first, last):
        factor = a[i] * b[i]
        for o in range(out.size):
            out[o] += factor * signal[i + o]


@njit(cache=True, nogil=True)
def _fill_common(
    steps: FloatArray, ones: FloatArray, signals: FloatArray, matrix: FloatArray, right: FloatArray
) -> None:
    """Fill the rows of pavement and ground in the matrix (size, size, trials) and the right sides (3, size, trials)."""
    last = steps.shape[1]
    for m in range(steps.shape[0]):
        for n in range(m + 1):
            _correlate(steps[m], steps[n], 0, last, signals[0], matrix[m, n])
        for c in range(3):
            _correlate(steps[m], ones, 0, last, signals[1 + c], right[c, m])


@njit(cache=True, nogil=True)
def _fill_bars(
    shapes: FloatArray,
    limits: NDArray[np.int64],
    steps: FloatArray,
    ones: FloatArray,
    signals: FloatArray,
    matrix: FloatArray,
    right: FloatArray,
) -> None:
    """Fill the rows of a layout's bars, ``shapes`` (bars, bins), in the matrix and the right sides."""
    base = steps.shape[0]
    for m in range(shapes.shape[0]):
        first, last = limits[m, 0], limits[m, 1]
        for n in range(base):
            _correlate(steps[n], shapes[m], first, last, signals[0], matrix[base + m, n])
        for n in range(m + 1):
            low, high = max(first, limits[n, 0]), min(last, limits[n, 1])
            _correlate(shapes[m], shapes[n], low, high, signals[0], matrix[base + m, base + n])
        for c in range(3):
            _correlate(shapes[m], ones, first, last, signals[1 + c], right[c, base + m])


@njit(cache=True, nogil=True)
def _factorise(matrix: FloatArray, stiffness: FloatArray, lower: FloatArray, diagonal: FloatArray) -> None:
    """Fill L and D (size, trials) of Cholesky's L D Lᵀ, with the prior's weights (size,); alike for all colours."""
    size, trials = matrix.shape[0], matrix.shape[2]
    for m in range(size):
        more = _SQUARE + stiffness[m]
        for o in range(trials):
            diagonal[m, o] = matrix[m, m, o] + more
        for n in range(m):
            for o in range(trials):
                own = matrix[m, n, o]
                for p in range(n):
                    own -= lower[m, p, o] * lower[n, p, o] * diagonal[p, o]
                lower[m, n, o] = own / diagonal[n, o]
                diagonal[m, o] -= lower[m, n, o] ** 2 * diagonal[n, o]
        for o in range(trials):
            diagonal[m, o] = max(diagonal[m, o], _SQUARE)


@njit(cache=True, nogil=True)
def _solve_levels(
    lower: FloatArray,
    diagonal: FloatArray,
    right: FloatArray,
    stiffness: FloatArray,
    excess: FloatArray,
    squares: float,
    levels: FloatArray,
    left: FloatArray,
) -> None:
    """Fill one colour's levels (size, trials) by substitution, and what is ``left`` of its squares (trials,).

    ``right`` (size, trials), ``stiffness`` and ``excess`` (size,).
    """
    size, trials = right.shape
    left[:] = squares
    for m in range(size):
        held = stiffness[m] * excess[m]
        again = held * excess[m]
        for o in range(trials):
            y = right[m, o] + held
            for n in range(m):
                y -= lower[m, n, o] * levels[n, o]
            levels[m, o] = y
            left[o] += again - y**2 / diagonal[m, o]
    for m in range(size - 1, -1, -1):
        for o in range(trials):
            own = levels[m, o] / diagonal[m, o]
            for n in range(m + 1, size):
                own -= lower[n, m, o] * levels[n, o]
            levels[m, o] = own


@njit(cache=True, nogil=True)
def _fill_misfit(left: FloatArray, whole: float, apart: bool, misfit: FloatArray) -> None:
    """Fill the misfits (trials,) of what is left of three colours (3, trials), or of grey and two tints."""
    for o in range(misfit.size):
        if apart:
            tints = max(left[1, o], 0.0) + max(left[2, o], 0.0) + QUANTUM * whole
            misfit[o] = max(math.sqrt((max(left[0, o], 0.0) + QUANTUM * whole) * tints), 1e-9)
        else:
            misfit[o] = max(left[0, o] + left[1, o] + left[2, o], 1e-9)


@njit(cache=True, nogil=True)
def misfits(
    total: FloatArray,
    weight: FloatArray,
    blurs: FloatArray,
    bars: FloatArray,
    prior: ExcessPrior,
    misfit: FloatArray,
    levels: FloatArray,
    apart: bool = False,
    slope: float = 0.0,
) -> None:
    """Fill the misfits of pavement, ground and bright bars along one edge, and their levels, of several layouts.

    The levels of each block are those of least squares; all bins count at every trial, which moves the model alone.
    The part that pavement and ground contribute to a profile is the same for all layouts, and is summed once.

    Parameters
    ----------
    total, weight : (blocks, bins, 3) and (blocks, bins), of `gather`.
    blurs : (blocks,) sigma of the picture, in bins.
    bars : (layouts, bars, blocks, 2) inner and outer side of each bar; one of zero width is absent.
    misfit, levels : (layouts, blocks, trials), and (layouts, blocks, trials, 2 + bars, 3): pavement, ground, each bar's
        excess.
    apart : the first colour is grey, the others are tints, which have their own noise: their misfits' geometric mean.
    slope : the ground rises or falls outwards as well; weight of the prior that it is level, in pixels; 0: it is level.
    """
    blocks, bins = weight.shape
    layouts, count, trials = bars.shape[0], bars.shape[1], misfit.shape[2]
    base = 3 if slope > 0.0 else 2
    middle, size = trials // 2, base + count
    origin = bins // 2 + middle
    steps, shapes, ones = np.empty((base, bins + trials)), np.empty((count, bins + trials)), np.ones(bins + trials)
    limits, signals = np.empty((count, 2), np.int64), np.zeros((4, bins + 2 * trials))
    matrix, right = np.empty((size, size, trials)), np.empty((3, size, trials))
    lower, diagonal, own = np.zeros((size, size, trials)), np.empty((size, trials)), np.empty((size, trials))
    squares, left, stiffness, excess = np.empty(3), np.empty((3, trials)), np.zeros(size), np.zeros(size)
    stiffness[2:base], stiffness[base:] = slope, prior.stiffness
    for k in range(blocks):
        fill_steps(steps[:2], blurs[k], origin)
        if base > 2:
            fill_slope(steps[2], blurs[k], origin, bins // 2)
        whole = _fill_signals(total[k], weight[k], 2 * middle, signals, squares)
        _fill_common(steps, ones, signals, matrix, right)
        for n in range(layouts):
            for m in range(count):
                fill_bar(shapes[m], bars[n, m, k, 0], bars[n, m, k, 1], blurs[k], origin, limits[m])
            _fill_bars(shapes, limits, steps, ones, signals, matrix, right)
            _factorise(matrix, stiffness, lower, diagonal)
            for c in range(3):
                excess[base:] = prior.excess[:, k, c]
                _solve_levels(lower, diagonal, right[c], stiffness, excess, squares[c], own, left[c])
                for o in range(trials):
                    levels[n, k, o, 0, c], levels[n, k, o, 1, c] = own[0, o], own[1, o]
                    for m in range(count):
                        levels[n, k, o, 2 + m, c] = own[base + m, o]
            _fill_misfit(left, whole, apart, misfit[n, k])


@njit(cache=True, nogil=True)
def line_likelihood(curves: FloatArray, steps: FloatArray, outlier: float, out: FloatArray) -> None:
    """Fill a line's log-likelihood ``out`` (trials, trials) at its displacements at the upper and the lower row.

    ``curves`` (blocks, trials) relative likelihoods of each block's displacement, in steps that go from ``steps[0]``
    px at the upper to ``steps[1]`` at the lower row; a block is an outlier with the likelihood ``outlier``.
    """
    blocks, trials = curves.shape
    middle = trials // 2
    # the product first, its logarithm once; no block is below the outlier's likelihood
    out[:] = 1.0
    for k in range(blocks):
        t = (k + 0.5) / blocks
        share = steps[0] * (1.0 - t) / (steps[0] * (1.0 - t) + steps[1] * t)
        for a in range(trials):
            for b in range(trials):
                place = (a - middle) * share + (b - middle) * (1.0 - share) + middle
                i = min(int(place), trials - 2)
                f = place - i
                out[a, b] *= curves[k, i] * (1.0 - f) + curves[k, i + 1] * f + outlier
    for a in range(trials):
        for b in range(trials):
            out[a, b] = math.log(out[a, b])


@njit(cache=True, nogil=True)
def moments(grid: FloatArray, steps: FloatArray, mean: FloatArray, covariance: FloatArray) -> None:
    """Fill the mean (2,) and covariance (2, 2) px of a line with the log-likelihood ``grid`` (trials, trials)."""
    trials = grid.shape[0]
    middle = trials // 2
    highest = grid.max()
    whole, m0, m1, c00, c01, c11 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(trials):
        for b in range(trials):
            p = math.exp(grid[a, b] - highest)
            x, y = steps[0] * (a - middle), steps[1] * (b - middle)
            whole += p
            m0 += p * x
            m1 += p * y
            c00 += p * x * x
            c01 += p * x * y
            c11 += p * y * y
    mean[0], mean[1] = m0 / whole, m1 / whole
    covariance[0, 0] = c00 / whole - mean[0] ** 2
    covariance[1, 1] = c11 / whole - mean[1] ** 2
    covariance[0, 1] = covariance[1, 0] = c01 / whole - mean[0] * mean[1]


@njit(cache=True, nogil=True)
def picked_trials(trials: int, steps: FloatArray, moved: FloatArray, picked: NDArray[np.int64]) -> None:
    """Fill which trial (2, blocks) displaces each block of both lines, moved outwards by (4,) px at the two rows."""
    blocks = picked.shape[1]
    for k in range(blocks):
        t = (k + 0.5) / blocks
        step = steps[0] * (1.0 - t) + steps[1] * t
        for line in range(2):
            at = (moved[2 * line] * (1.0 - t) + moved[2 * line + 1] * t) / step + trials // 2
            picked[line, k] = min(max(round(at), 0), trials - 1)


@njit(cache=True, nogil=True)
def picked_levels(levels: FloatArray, steps: FloatArray, moved: FloatArray, out: FloatArray) -> None:
    """Fill the levels (2, blocks, 4, 3) of both lines moved outwards by (4,) px, of those of all trials.

    ``levels`` (2, blocks, trials, 4, 3).
    """
    picked = np.empty((2, levels.shape[1]), np.int64)
    picked_trials(levels.shape[2], steps, moved, picked)
    for line in range(2):
        for k in range(levels.shape[1]):
            for m in range(4):
                for c in range(3):
                    out[line, k, m, c] = levels[line, k, picked[line, k], m, c]
