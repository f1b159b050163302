"""Compiled arithmetic of the profile across an edge: gathering it, levels by least squares, a line's likelihood."""

import math

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray

_SQUARE = 1e-9  # of a level that nothing measures


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
            # what lies beyond the other line is not this edge's pavement
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


@njit(cache=True, nogil=True, inline="always")
def _under(z: float) -> float:
    """Return the normal distribution below z."""
    return 0.5 * (1.0 + math.erf(0.7071067811865476 * z))


@njit(cache=True, nogil=True, fastmath=True)
def _product(a: FloatArray, i: int, b: FloatArray, j: int, shift: int, count: int) -> float:
    """Return the sum of products of row ``i`` of a and row ``j`` of b, b from ``shift`` on."""
    total = 0.0
    for k in range(count):
        total += a[i, k] * b[j, k + shift]
    return total


@njit(cache=True, nogil=True)
def misfits(
    total: FloatArray,
    weight: FloatArray,
    blurs: FloatArray,
    bars: FloatArray,
    usual: FloatArray,
    stiffness: FloatArray,
    misfit: FloatArray,
    levels: FloatArray,
) -> None:
    """Fill the misfit (blocks, trials) of pavement, ground and bright bars along one edge, and their levels.

    The levels of each block are those of least squares; all bins count at every trial, which moves the model alone.

    Parameters
    ----------
    total, weight : (blocks, bins, 3) and (blocks, bins), of `gather`.
    blurs : (blocks,) sigma of the picture, in bins; ``bars`` (bars, blocks, 2) inner and outer side of each bar.
    usual : (bars, blocks, 3) each bar's usual excess over what it lies on, held with ``stiffness`` (bars,), in pixels.
    misfit, levels : (blocks, trials), and (blocks, trials, 2 + bars, 3): pavement, ground, each bar's excess.
    """
    blocks, bins = weight.shape
    trials, count = misfit.shape[1], bars.shape[0]
    half, middle, size = bins // 2, trials // 2, 2 + bars.shape[0]
    shapes = np.empty((size, bins + trials))
    normal, low, ratio = np.empty((size, size)), np.zeros((size, size)), np.empty(size)
    b, y = np.empty((3, size)), np.empty(size)
    weighed, colours = np.empty((size, bins)), np.empty((3, bins))
    for k in range(blocks):
        for i in range(bins + trials):
            z = float(i - half - middle)
            shapes[1, i] = _under(z / blurs[k])
            shapes[0, i] = 1.0 - shapes[1, i]
            for n in range(count):
                shapes[2 + n, i] = _under((z - bars[n, k, 0]) / blurs[k]) - _under((z - bars[n, k, 1]) / blurs[k])
        square = 0.0
        for i in range(bins):
            for c in range(3):
                colours[c, i] = total[k, i, c]
                if weight[k, i] > 0.0:
                    square += colours[c, i] ** 2 / weight[k, i]
        for o in range(trials):
            shift = 2 * middle - o
            for m in range(size):
                for i in range(bins):
                    weighed[m, i] = weight[k, i] * shapes[m, i + shift]
                for n in range(m + 1):
                    normal[m, n] = _product(weighed, m, shapes, n, shift, bins)
                for c in range(3):
                    b[c, m] = _product(colours, c, shapes, m, shift, bins)
            # Cholesky's L D Lᵀ of the levels, the same for all colours
            for m in range(size):
                normal[m, m] += _SQUARE + (stiffness[m - 2] if m > 1 else 0.0)
                ratio[m] = normal[m, m]
                for n in range(m):
                    own = normal[m, n]
                    for p in range(n):
                        own -= low[m, p] * low[n, p] * ratio[p]
                    low[m, n] = own / ratio[n]
                    ratio[m] -= low[m, n] ** 2 * ratio[n]
                ratio[m] = max(ratio[m], _SQUARE)
            left = square
            for c in range(3):
                for m in range(size):
                    y[m] = b[c, m]
                    if m > 1:
                        y[m] += stiffness[m - 2] * usual[m - 2, k, c]
                        left += stiffness[m - 2] * usual[m - 2, k, c] ** 2
                    for n in range(m):
                        y[m] -= low[m, n] * y[n]
                    left -= y[m] ** 2 / ratio[m]
                for m in range(size - 1, -1, -1):
                    own = y[m] / ratio[m]
                    for n in range(m + 1, size):
                        own -= low[n, m] * levels[k, o, n, c]
                    levels[k, o, m, c] = own
            misfit[k, o] = max(left, 1e-9)


@njit(cache=True, nogil=True)
def line_likelihood(curves: FloatArray, steps: FloatArray, outlier: float, out: FloatArray) -> None:
    """Fill a line's log-likelihood ``out`` (trials, trials) at its displacements at the upper and the lower row.

    ``curves`` (blocks, trials) relative likelihoods of each block's displacement, in steps that go from ``steps[0]``
    px at the upper to ``steps[1]`` at the lower row; a block shows something else with the likelihood ``outlier``.
    """
    blocks, trials = curves.shape
    middle = trials // 2
    for a in range(trials):
        for b in range(trials):
            # the product, its logarithm once; no block is below the outlier's likelihood
            total = 1.0
            for k in range(blocks):
                t = (k + 0.5) / blocks
                upper, lower = steps[0] * (1.0 - t), steps[1] * t
                place = ((a - middle) * upper + (b - middle) * lower) / (upper + lower) + middle
                i = min(int(place), trials - 2)
                f = place - i
                total *= curves[k, i] * (1.0 - f) + curves[k, i + 1] * f + outlier
            out[a, b] = math.log(total)


@njit(cache=True, nogil=True)
def best_lines(grids: FloatArray, steps: FloatArray, offset: FloatArray, weight: FloatArray, out: FloatArray) -> float:
    """Fill ``out`` (4,) px with the outward displacements of both lines that are likeliest, given a prior.

    Returns their log-likelihood, the prior's part included.

    ``grids`` (2, trials, trials) of `line_likelihood`; the prior's mean is at ``offset`` (4,) outwards, its inverse
    covariance ``weight`` (4, 4). Line by line, each given the other, from either one's own best.
    """
    trials = grids.shape[1]
    middle = trials // 2
    highest = -np.inf
    d, r = np.zeros(4), np.zeros(4)
    for first in range(2):
        d[:] = offset
        total = 0.0
        for turn in range(4):
            line = (first + turn) % 2
            i, j = 2 * line, 2 - 2 * line
            pull0 = weight[i, j] * (d[j] - offset[j]) + weight[i, j + 1] * (d[j + 1] - offset[j + 1])
            pull1 = weight[i + 1, j] * (d[j] - offset[j]) + weight[i + 1, j + 1] * (d[j + 1] - offset[j + 1])
            w00, w01, w11 = weight[i, i], weight[i, i + 1], weight[i + 1, i + 1]
            if turn == 0:
                # whatever the other line does
                pull0, pull1 = 0.0, 0.0
            best, at, bt = -np.inf, 0, 0
            for a in range(trials):
                x = steps[0] * (a - middle) - offset[i]
                for b in range(trials):
                    y = steps[1] * (b - middle) - offset[i + 1]
                    own = grids[line, a, b] - 0.5 * (w00 * x * x + 2.0 * w01 * x * y + w11 * y * y)
                    own -= pull0 * x + pull1 * y
                    if own > best:
                        best, at, bt = own, a, b
            d[i], d[i + 1] = steps[0] * (at - middle), steps[1] * (bt - middle)
            if turn == 2:
                total = grids[line, at, bt]
            elif turn == 3:
                total += grids[line, at, bt]
        for i in range(4):
            r[i] = d[i] - offset[i]
        for i in range(4):
            for j in range(4):
                total -= 0.5 * r[i] * weight[i, j] * r[j]
        if total > highest:
            highest = total
            out[:] = d
    return highest


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
