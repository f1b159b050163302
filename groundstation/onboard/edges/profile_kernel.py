"""Compiled arithmetic of the profile across an edge: gathering it, levels by least squares, a line's likelihood."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray

_SQUARE = 1e-9  # of a level that nothing measures
# of a pixel's grey and of its tints, that a codec leaves unknown: two grey levels
QUANTUM = (2.0 / 255.0) ** 2


@njit(cache=True, nogil=True)
def gather(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    steps: FloatArray,
    total: FloatArray,
    weight: FloatArray,
) -> None:
    """Add the pixels about both lines to straightened profiles, each row's in its own steps.

    ``steps`` (2,) px of a bin at the upper and the lower row; ``total`` (2, blocks, bins, 3) sums of colours (0 to 1)
    and ``weight`` (2, blocks, bins), outwards to the right, the middle bin on the line.
    """
    blocks, bins = weight.shape[1], weight.shape[2]
    half, height = bins // 2, rows[1] - rows[0]
    for row in range(max(math.ceil(rows[0]), 0), min(math.floor(rows[1]), image.shape[0] - 1) + 1):
        t = (row - rows[0]) / height
        k = min(int(t * blocks), blocks - 1)
        step = steps[0] * (1.0 - t) + steps[1] * t
        for line in range(2):
            outwards = (-1.0 if line == 0 else 1.0) / step
            edge = x[2 * line] * (1.0 - t) + x[2 * line + 1] * t
            # pixels beyond the other line are not this edge's pavement
            other = x[2 - 2 * line] * (1.0 - t) + x[3 - 2 * line] * t
            first = max(math.ceil(max(edge - half * step, other if line == 1 else 0.0)), 0)
            last = min(math.floor(min(edge + half * step, other if line == 0 else np.inf)), image.shape[1] - 1)
            for j in range(first, last + 1):
                place = outwards * (j - edge) + half
                i = int(place)
                if i >= bins - 1:
                    continue
                f = place - i
                for c in range(3):
                    colour = image[row, j, c] / 255.0
                    total[line, k, i, c] += (1.0 - f) * colour
                    total[line, k, i + 1, c] += f * colour
                weight[line, k, i] += 1.0 - f
                weight[line, k, i + 1] += f


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


@njit(cache=True, nogil=True, fastmath=True)
def _product(a: FloatArray, i: int, b: FloatArray, j: int, shift: int, first: int, last: int) -> float:
    """Return the sum of products of row ``i`` of a and row ``j`` of b over bins from first to before last.

    Row j is taken from ``shift`` on.
    """
    total = 0.0
    for k in range(first, last):
        total += a[i, k] * b[j, k + shift]
    return total


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


@njit(cache=True, nogil=True)
def _fill_colours(total: FloatArray, weight: FloatArray, colours: FloatArray, squares: FloatArray) -> float:
    """Fill the colours (3, bins) of a block's sums (bins, 3), and their squares (3,) over the weights (bins,).

    Returns the sum of the weights.
    """
    whole = 0.0
    squares[:] = 0.0
    for i in range(weight.size):
        whole += weight[i]
        for c in range(3):
            colours[c, i] = total[i, c]
            if weight[i] > 0.0:
                squares[c] += colours[c, i] ** 2 / weight[i]
    return whole


@njit(cache=True, nogil=True)
def _fill_common(
    weight: FloatArray, colours: FloatArray, steps: FloatArray, shift: int, weighed: FloatArray, common: FloatArray
) -> None:
    """Fill the weighted steps (2, bins), and ``common`` (2, 5): the matrix and the right sides of the steps."""
    bins = weight.size
    for m in range(2):
        for i in range(bins):
            weighed[m, i] = weight[i] * steps[m, i + shift]
        for n in range(m + 1):
            common[m, n] = _product(weighed, m, steps, n, shift, 0, bins)
        for c in range(3):
            common[m, 2 + c] = _product(colours, c, steps, m, shift, 0, bins)


@njit(cache=True, nogil=True)
def _fill_bars(
    weight: FloatArray,
    weighed: FloatArray,
    colours: FloatArray,
    shapes: FloatArray,
    limits: NDArray[np.int64],
    shift: int,
    matrix: FloatArray,
    right: FloatArray,
) -> None:
    """Fill the rows of a layout's bars, ``shapes`` (bars, bins), in the matrix and the right sides (3, size)."""
    for m in range(shapes.shape[0]):
        first, last = max(limits[m, 0] - shift, 0), min(limits[m, 1] - shift, weight.size)
        for n in range(2):
            matrix[2 + m, n] = _product(weighed, n, shapes, m, shift, first, last)
        for n in range(m + 1):
            own = 0.0
            for i in range(max(first, limits[n, 0] - shift), min(last, limits[n, 1] - shift)):
                own += weight[i] * shapes[m, i + shift] * shapes[n, i + shift]
            matrix[2 + m, 2 + n] = own
        for c in range(3):
            right[c, 2 + m] = _product(colours, c, shapes, m, shift, first, last)


@njit(cache=True, nogil=True)
def _factorise(matrix: FloatArray, stiffness: FloatArray, lower: FloatArray, diagonal: FloatArray) -> None:
    """Fill L and D of Cholesky's L D Lᵀ, with the prior's weights (bars,); they are the same for all colours."""
    for m in range(matrix.shape[0]):
        matrix[m, m] += _SQUARE + (stiffness[m - 2] if m > 1 else 0.0)
        diagonal[m] = matrix[m, m]
        for n in range(m):
            own = matrix[m, n]
            for p in range(n):
                own -= lower[m, p] * lower[n, p] * diagonal[p]
            lower[m, n] = own / diagonal[n]
            diagonal[m] -= lower[m, n] ** 2 * diagonal[n]
        diagonal[m] = max(diagonal[m], _SQUARE)


@njit(cache=True, nogil=True)
def _solve_levels(
    lower: FloatArray,
    diagonal: FloatArray,
    right: FloatArray,
    stiffness: FloatArray,
    excess: FloatArray,
    k: int,
    squares: FloatArray,
    y: FloatArray,
    levels: FloatArray,
    left: FloatArray,
) -> None:
    """Fill the levels (size, 3) of block ``k`` by substitution, ``y`` (size,) between, and what is ``left`` (3,)."""
    size = y.size
    for c in range(3):
        left[c] = squares[c]
        for m in range(size):
            y[m] = right[c, m]
            if m > 1:
                y[m] += stiffness[m - 2] * excess[m - 2, k, c]
                left[c] += stiffness[m - 2] * excess[m - 2, k, c] ** 2
            for n in range(m):
                y[m] -= lower[m, n] * y[n]
            left[c] -= y[m] ** 2 / diagonal[m]
        for m in range(size - 1, -1, -1):
            own = y[m] / diagonal[m]
            for n in range(m + 1, size):
                own -= lower[n, m] * levels[n, c]
            levels[m, c] = own


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
    """
    blocks, bins = weight.shape
    excess, stiffness = prior.excess, prior.stiffness
    layouts, count, trials = bars.shape[0], bars.shape[1], misfit.shape[2]
    middle, size = trials // 2, 2 + count
    origin = bins // 2 + middle
    steps, shapes = np.empty((2, bins + trials)), np.empty((layouts, count, bins + trials))
    limits, common = np.empty((layouts, count, 2), np.int64), np.empty((2, 5))
    weighed, colours = np.empty((2, bins)), np.empty((3, bins))
    matrix, right = np.empty((size, size)), np.empty((3, size))
    lower, diagonal, y = np.zeros((size, size)), np.empty(size), np.empty(size)
    squares, left = np.empty(3), np.empty(3)
    for k in range(blocks):
        fill_steps(steps, blurs[k], origin)
        for n in range(layouts):
            for m in range(count):
                fill_bar(shapes[n, m], bars[n, m, k, 0], bars[n, m, k, 1], blurs[k], origin, limits[n, m])
        whole = _fill_colours(total[k], weight[k], colours, squares)
        for o in range(trials):
            shift = 2 * middle - o
            _fill_common(weight[k], colours, steps, shift, weighed, common)
            for n in range(layouts):
                for m in range(2):
                    for other in range(m + 1):
                        matrix[m, other] = common[m, other]
                    for c in range(3):
                        right[c, m] = common[m, 2 + c]
                _fill_bars(weight[k], weighed, colours, shapes[n], limits[n], shift, matrix, right)
                _factorise(matrix, stiffness, lower, diagonal)
                _solve_levels(lower, diagonal, right, stiffness, excess, k, squares, y, levels[n, k, o], left)
                if apart:
                    tints = max(left[1], 0.0) + max(left[2], 0.0) + QUANTUM * whole
                    misfit[n, k, o] = max(math.sqrt((max(left[0], 0.0) + QUANTUM * whole) * tints), 1e-9)
                else:
                    misfit[n, k, o] = max(left[0] + left[1] + left[2], 1e-9)


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
