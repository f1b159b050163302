"""Solving stations and landmarks: robustly, then without what does not fit, with its covariance."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.information import inverse_with_floor
from calibration.landmarks.problem import LandmarkProblem
from calibration.landmarks.rejection import LandmarkFitError, find_outlier, single_sightings
from calibration.landmarks.solver import linearised, solve_kept, white_residuals
from groundstation.arrays import FloatArray, MaskArray
from groundstation.geometry.chi_square import chi_square_quantile

_MOST_REJECTIONS = 60
# a fit is worse than its noise allows, and its sigmas are raised, if chance does it this rarely
_MISFIT_PROBABILITY = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandmarkFit:
    """The solution of a `LandmarkProblem` of p parameters, q unknowns and n observations.

    Attributes
    ----------
    change, covariance : (p,), (p, p) the estimate, rotations as small angles about the solution.
    information : (q, q) of the unknowns, with their priors, noise as stated.
    kept : (n,) observations used; ``length`` (n,) of the residuals in sigmas, ``residual_px`` (n, 2).
    rejected_landmarks : name to the error of its coordinates in sigmas.
    chi_square, freedom : of the observations used, and its degrees of freedom.
    raised : the factor on all sigmas for a fit that is worse than its noise, otherwise 1.
    """

    problem: LandmarkProblem
    unknowns: FloatArray
    change: FloatArray
    covariance: FloatArray
    information: FloatArray
    kept: MaskArray
    length: FloatArray
    residual_px: FloatArray
    rejected_landmarks: dict[str, float]
    chi_square: float
    freedom: int
    raised: float

    def sigma(self, name: str) -> float:
        """Return one sigma of a parameter."""
        k = self.problem.names.index(name)
        return float(np.sqrt(self.covariance[k, k]))

    def block(self, names: Sequence[str]) -> FloatArray:
        """Return the covariance (m, m) of some parameters."""
        places = [self.problem.names.index(name) for name in names]
        return np.asarray(self.covariance[np.ix_(places, places)])


def solve_landmarks(problem: LandmarkProblem, start: FloatArray | None = None) -> LandmarkFit:
    """Estimate the unknowns, initially zero if not given (q,); leaves out misfitting observations and landmarks."""
    unknowns = np.zeros(len(problem.known)) if start is None else start
    kept = np.ones(len(problem.pixel_px), dtype=np.bool_)
    rejected: dict[str, float] = {}
    for robust in (True, False):
        for _ in range(_MOST_REJECTIONS):
            unknowns = solve_kept(problem, unknowns, kept, robust=robust)
            single = single_sightings(problem, unknowns, kept)
            if single.any():
                kept = kept & ~single
                continue
            found = find_outlier(problem, unknowns, kept)
            if found.nothing:
                break
            rejected.update(found.landmarks)
            kept = kept & ~found.omitted
            if not kept.any():
                raise LandmarkFitError("sightings: got none that fits another; wanted landmarks at their coordinates")
    return _finished(problem, unknowns, kept, rejected)


def _finished(
    problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, rejected: dict[str, float]
) -> LandmarkFit:
    solution = linearised(problem, unknowns, kept)
    information = solution.information
    chi_square, freedom = solution.chi_square, len(solution.residual) - len(unknowns)
    misfit = freedom > 0 and chi_square > chi_square_quantile(1.0 - _MISFIT_PROBABILITY, freedom)
    raised = float(np.sqrt(chi_square / freedom)) if misfit else 1.0
    return LandmarkFit(
        problem=problem,
        unknowns=unknowns,
        change=problem.spread @ unknowns,
        covariance=problem.spread @ inverse_with_floor(information) @ problem.spread.T * raised**2,
        information=information,
        kept=kept,
        length=np.linalg.norm(white_residuals(problem, unknowns), axis=1),
        residual_px=problem.evaluate(unknowns).pixel_px - problem.pixel_px,
        rejected_landmarks=rejected,
        chi_square=chi_square,
        freedom=freedom,
        raised=raised,
    )


def information_with(
    problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, *, pixel: float = 1.0, angle: float = 1.0
) -> FloatArray:
    """Return the information (q, q) of the same observations with other noise: factors on the variances."""
    seen = problem.evaluate(unknowns)
    by_pixel, by_angle = problem.variances
    noise = pixel * by_pixel[:, None, None] * np.eye(2)
    noise = noise + angle * by_angle[:, None, None] * seen.by_angle @ np.swapaxes(seen.by_angle, 1, 2)
    use = kept & seen.usable
    gain = np.swapaxes(seen.jacobian[use], 1, 2) @ np.linalg.inv(noise[use])
    return np.asarray((gain @ seen.jacobian[use]).sum(axis=0) + np.diag(problem.known.astype(np.float64)))
