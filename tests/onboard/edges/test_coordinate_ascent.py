"""The choice of both lines' displacements: the same as of all of them, with priors that tie the lines."""

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.coordinate_ascent import best_displacements

STEPS = np.array([0.5, 1.0])
TRIALS = 11


def peaks(rng: np.random.Generator) -> FloatArray:
    """Return log-likelihoods (2, trials, trials) of lines with an edge of their own, and a stronger one elsewhere."""
    places = np.stack(np.meshgrid(*[np.arange(TRIALS)] * 2, indexing="ij"), axis=-1)
    grids = np.zeros((2, TRIALS, TRIALS))
    for line in range(2):
        for height in rng.uniform(5.0, 60.0, 3):
            own = np.exp(-0.5 * ((places - rng.uniform(0.0, TRIALS - 1.0, 2)) ** 2).sum(axis=2) / 1.5**2)
            grids[line] = np.maximum(grids[line], height * own)
    return grids


def best_of_all(grids: FloatArray, offset: FloatArray, weight: FloatArray) -> float:
    """Return the highest sum of scores less the prior's cost, of every displacement of both lines."""
    places = np.arange(TRIALS) - TRIALS // 2
    one = np.stack(np.meshgrid(STEPS[0] * places, STEPS[1] * places, indexing="ij"), axis=-1).reshape(-1, 2)
    left, right = one - offset[:2], one - offset[2:]
    cost = 0.5 * np.einsum("ni,ij,nj->n", left, weight[:2, :2], left)[:, None]
    cost = cost + 0.5 * np.einsum("ni,ij,nj->n", right, weight[2:, 2:], right) + left @ weight[:2, 2:] @ right.T
    return float((grids[0].ravel()[:, None] + grids[1].ravel() - cost).max())


def ties(rng: np.random.Generator) -> FloatArray:
    """Return a covariance (4, 4) px² of lines that move outwards equally, and each a little separately."""
    own = np.diag(rng.uniform(0.05, 0.6, 4))
    return np.asarray(own + rng.uniform(1.0, 8.0) * np.outer(shared := np.tile([0.5, 1.0], 2), shared))


def test_lines_that_a_prior_ties_are_the_best_of_all() -> None:
    """From either line's block of the inverse, the line given the other at its prior: up to 27 nats lost of pictures.

    Here that lost more than half a nat in one of twenty draws; a comparison of layouts is decided by 20.
    """
    rng, lost = np.random.default_rng(5), list[float]()
    for _ in range(60):
        grids, offset, weight = peaks(rng), rng.normal(0.0, 0.7, 4), np.linalg.inv(ties(rng))
        found = np.empty(4)
        best = best_displacements(grids, -np.inf, STEPS, offset, weight, found)
        at = np.round(found / np.tile(STEPS, 2)).astype(int) + TRIALS // 2
        r = found - offset
        worth = grids[0, at[0], at[1]] + grids[1, at[2], at[3]] - 0.5 * float(r @ weight @ r)
        assert best == pytest.approx(worth)
        lost.append(best_of_all(grids, offset, weight) - best)
    assert max(np.abs(lost)) < 1e-6


def test_both_lines_are_displaced_together_by_the_prior() -> None:
    """The right line's score is highest off its place; a prior that moves both lines equally leaves it at its place."""
    scores = np.zeros((2, 21, 21))
    scores[0, 14, 14] = 1.0
    scores[1, 14, 14], scores[1, 3, 3] = 0.9, 1.0
    out = np.zeros(4)
    for shared, right in ((25.0, 2.0), (0.0, -3.5)):
        prior = np.full((4, 4), shared) + (26.0 - shared) * np.eye(4)
        worth = best_displacements(scores, 0.0, np.full(2, 0.5), np.zeros(4), np.linalg.inv(prior) / 40, out)
        assert 0.0 < worth < 2.0
        np.testing.assert_array_equal(out, [2.0, 2.0, right, right])


def test_a_line_without_a_score_has_no_place() -> None:
    scores, found = np.full((2, 21, 21), -1.0), np.zeros(4)
    scores[0] = 1.0
    assert best_displacements(scores, 0.0, STEPS, np.zeros(4), np.eye(4), found) == -np.inf
    # below none of those that count
    scores[1, 3, 5] = 0.0
    assert best_displacements(scores, 0.0, STEPS, np.zeros(4), 1e-6 * np.eye(4), found) > 0.0
    np.testing.assert_array_equal(found[2:], [-3.5, -5.0])
