"""Compiled choice among displacements of both edges on a grid: each line's scores, and a prior that ties them."""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray

# far more turns than are ever taken: each that changes anything raises the sum, mostly two or three do
_MOST_TURNS = 20


class _LinePrior(NamedTuple):
    """The prior of one line's two displacements: weights w00, w01, w11, and the other line's pull on both."""

    w00: float
    w01: float
    w11: float
    pull0: float
    pull1: float


@njit(cache=True, nogil=True)
def _marginal_prior(weight: FloatArray, i: int, j: int) -> _LinePrior:
    """Return the prior of the line at i, i + 1, whatever the one at j, j + 1 does: Schur's complement."""
    w00, w01, w11 = weight[i, i], weight[i, i + 1], weight[i + 1, i + 1]
    u0, u1, v0, v1 = weight[i, j], weight[i, j + 1], weight[i + 1, j], weight[i + 1, j + 1]
    determinant = weight[j, j] * weight[j + 1, j + 1] - weight[j, j + 1] ** 2
    if determinant > 0.0:
        i00, i11 = weight[j + 1, j + 1] / determinant, weight[j, j] / determinant
        i01 = -weight[j, j + 1] / determinant
        w00 -= u0 * (i00 * u0 + i01 * u1) + u1 * (i01 * u0 + i11 * u1)
        w01 -= u0 * (i00 * v0 + i01 * v1) + u1 * (i01 * v0 + i11 * v1)
        w11 -= v0 * (i00 * v0 + i01 * v1) + v1 * (i01 * v0 + i11 * v1)
    return _LinePrior(w00, w01, w11, 0.0, 0.0)


@njit(cache=True, nogil=True)
def _conditional_prior(weight: FloatArray, i: int, j: int, r: FloatArray) -> _LinePrior:
    """Return the prior of the line at i, i + 1, given the other one's residuals ``r`` (4,) at j, j + 1."""
    pull0 = weight[i, j] * r[j] + weight[i, j + 1] * r[j + 1]
    pull1 = weight[i + 1, j] * r[j] + weight[i + 1, j + 1] * r[j + 1]
    return _LinePrior(weight[i, i], weight[i, i + 1], weight[i + 1, i + 1], pull0, pull1)


@njit(cache=True, nogil=True)
def _best_of_line(
    scores: FloatArray, least: float, steps: FloatArray, offset: FloatArray, prior: _LinePrior
) -> tuple[int, int]:
    """Return the indices in ``scores`` (trials, trials) of the best displacement; (−1, −1) where there is no score."""
    trials = scores.shape[0]
    middle = trials // 2
    best, up, low = -np.inf, -1, -1
    for a in range(trials):
        x = steps[0] * (a - middle) - offset[0]
        for b in range(trials):
            if scores[a, b] < least:
                continue
            y = steps[1] * (b - middle) - offset[1]
            own = scores[a, b] - 0.5 * (prior.w00 * x * x + 2.0 * prior.w01 * x * y + prior.w11 * y * y)
            own -= prior.pull0 * x + prior.pull1 * y
            if own > best:
                best, up, low = own, a, b
    return up, low


@njit(cache=True, nogil=True)
def best_displacements(
    scores: FloatArray, least: float, steps: FloatArray, offset: FloatArray, weight: FloatArray, out: FloatArray
) -> float:
    """Fill ``out`` (4,) px with the displacements of both lines of the best score, less the cost of the prior.

    In gusts both lines move together, and a line alone does not jump to its neighbour. Line by line, each
    given the other, until neither moves: from either one's own best independent of the other, by the prior's marginal
    (Schur's complement of the inverse covariance). A line's own block of that would be conditional on the other line at
    its prior mean: with their correlation, none would leave that position.

    Parameters
    ----------
    scores : (2, trials, trials), of either line at its displacements at the upper and the lower row, the middle zero;
        below ``least`` there is no edge.
    steps : (2,) px between displacements, at either row.
    offset, weight : the prior's mean (4,) px and inverse covariance (4, 4), in units of the scores.
    out : of the upper and the lower row of the first line, then of the second's.

    Returns
    -------
    sum of the scores less dᵀ weight d / 2; −inf where a line has no score.
    """
    trials = scores.shape[1]
    middle = trials // 2
    highest = -np.inf
    d, r, at = np.zeros(4), np.zeros(4), np.zeros((2, 2), np.int64)
    for first in range(2):
        at[:] = -1
        for turn in range(_MOST_TURNS):
            line = (first + turn) % 2
            i, j = 2 * line, 2 - 2 * line
            prior = _marginal_prior(weight, i, j) if turn == 0 else _conditional_prior(weight, i, j, r)
            up, low = _best_of_line(scores[line], least, steps, offset[i : i + 2], prior)
            if up < 0:
                return -np.inf
            settled = turn > 1 and at[line, 0] == up and at[line, 1] == low
            at[line, 0], at[line, 1] = up, low
            d[i], d[i + 1] = steps[0] * (up - middle), steps[1] * (low - middle)
            r[i], r[i + 1] = d[i] - offset[i], d[i + 1] - offset[i + 1]
            if settled:
                break
        total = scores[0, at[0, 0], at[0, 1]] + scores[1, at[1, 0], at[1, 1]]
        for i in range(4):
            for j in range(4):
                total -= 0.5 * r[i] * weight[i, j] * r[j]
        if total > highest:
            highest = total
            out[:] = d
    return highest
