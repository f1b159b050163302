"""Least squares over stations and landmarks: the solution for given sightings, its residuals and their whitening."""

import numpy as np

from calibration.landmarks.problem import LandmarkProblem
from calibration.robust_fit import FitProblem, Linearisation, Loss, fit_reweighted, pixel_linearisation, whitening_of
from groundstation.arrays import FloatArray, MaskArray

_ROBUST_ROUNDS = 3
_FINAL_ROUNDS = 2


def weighted_problem(
    problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, loss: Loss = Loss.SQUARED
) -> FitProblem:
    """Return the fit of the kept sightings (n,) with the noise of each as it is at unknowns (q,)."""
    whitening, seen_px = whitening_at(problem, unknowns), problem.pixel_px
    return FitProblem(
        evaluate=lambda at: pixel_linearisation(problem.evaluate(at), seen_px, whitening, kept),
        prior_sigma=np.where(problem.known, 1.0, np.inf),
        step_scale=np.ones(len(unknowns)),
        loss=loss,
    )


def linearised(problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray) -> Linearisation:
    """Return residuals of kept sightings and priors at unknowns (q,), in sigmas, and their Jacobian."""
    return weighted_problem(problem, unknowns, kept).linearise(unknowns)


def solve_kept(problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, *, robust: bool) -> FloatArray:
    """Return the unknowns (q,) for the kept sightings (n,), from a start (q,)."""
    loss, rounds = (Loss.SOFT_L1, _ROBUST_ROUNDS) if robust else (Loss.SQUARED, _FINAL_ROUNDS)
    return fit_reweighted(lambda at: weighted_problem(problem, at, kept, loss), unknowns, rounds)


def whitening_at(problem: LandmarkProblem, unknowns: FloatArray) -> FloatArray:
    """Return W (n, 2, 2): W r has unit covariance, noise of pixel and of angle readings together."""
    by_angle = problem.evaluate(unknowns).by_angle
    pixel, angle = problem.variances
    noise = pixel[:, None, None] * np.eye(2) + angle[:, None, None] * by_angle @ np.swapaxes(by_angle, 1, 2)
    return whitening_of(noise)


def white_residuals(problem: LandmarkProblem, unknowns: FloatArray) -> FloatArray:
    """Return each sighting's residual (n, 2) in sigmas; infinite behind the camera."""
    seen = problem.evaluate(unknowns)
    off = np.einsum("nij,nj->ni", whitening_at(problem, unknowns), seen.pixel_px - problem.pixel_px)
    return np.asarray(np.where(seen.usable[:, None], off, np.inf))
