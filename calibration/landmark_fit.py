"""Solving stations and landmarks: robustly, then without what does not fit, with its covariance."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2

from calibration.landmark_problem import LandmarkProblem
from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import GroundstationError

# soft-L1 bends here, in sigmas
_BEND_SIGMA = 1.5
# of a two-dimensional normal length one in 25 000 exceeds this; of a landmark's three coordinates one in 6000
GROSS_SIGMA = 4.5
_MEDIAN_LENGTH = 1.1774
_ROBUST_ROUNDS = 3
_FINAL_ROUNDS = 2
_MOST_REJECTIONS = 60
# a fit is worse than its noise allows, and its sigmas are raised, if chance does it this rarely
_MISFIT_PROBABILITY = 0.01
_LEAST_INFORMATION = 1e-14


class LandmarkFitError(GroundstationError):
    """The sightings do not determine what is asked for, or contradict each other."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandmarkFit:
    """The solution of a `LandmarkProblem` of p parameters, q unknowns and n looks.

    Attributes
    ----------
    change, covariance : (p,), (p, p) what was found, rotations as small angles about the solution.
    information : (q, q) of the unknowns, those known before included, noise as stated.
    kept : (n,) looks that were used; ``length`` (n,) of the residuals in sigmas, ``residual_px`` (n, 2).
    rejected_landmarks : name to how many sigmas its coordinates are off.
    chi_square, freedom : of what was kept, and its degrees of freedom.
    raised : the factor on all sigmas for a fit that is worse than its noise, else 1.
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


@dataclass(slots=True, eq=False)
class _Weighted:
    """Residuals and Jacobian of kept looks and of what was known, in sigmas; computed once for each point."""

    problem: LandmarkProblem
    whitening: FloatArray
    kept: MaskArray
    _at: bytes = b""
    _residual: FloatArray = field(default_factory=lambda: np.zeros(0))
    _jacobian: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def residual(self, unknowns: FloatArray) -> FloatArray:
        self._compute(unknowns)
        return self._residual

    def jacobian(self, unknowns: FloatArray) -> FloatArray:
        self._compute(unknowns)
        return self._jacobian

    def _compute(self, unknowns: FloatArray) -> None:
        if unknowns.tobytes() == self._at:
            return
        seen = self.problem.evaluate(unknowns)
        whitening = self.whitening[self.kept] * seen.usable[self.kept, None, None]
        off = np.einsum("nij,nj->ni", whitening, (seen.pixel_px - self.problem.pixel_px)[self.kept])
        known = self.problem.known
        self._residual = np.concatenate([off.ravel(), unknowns[known]])
        by_looks = (whitening @ seen.jacobian[self.kept]).reshape(-1, len(unknowns))
        self._jacobian = np.concatenate([by_looks, np.eye(len(unknowns))[known]])
        self._at = unknowns.tobytes()


def solve_landmarks(problem: LandmarkProblem, start: FloatArray | None = None) -> LandmarkFit:
    """Find the unknowns, zero at the start if not given (q,); leaves out looks and landmarks that do not fit."""
    unknowns = np.zeros(len(problem.known)) if start is None else start
    kept = np.ones(len(problem.pixel_px), dtype=np.bool_)
    rejected: dict[str, float] = {}
    for robust in (True, False):
        for _ in range(_MOST_REJECTIONS):
            unknowns = _solve(problem, unknowns, kept, robust=robust)
            offence, bad = _worst(problem, unknowns, kept, rejected)
            if not bad.any() and not offence:
                break
            rejected.update(offence)
            kept = kept & ~bad & ~_of_landmarks(problem, offence)
            if not kept.any():
                raise LandmarkFitError("sightings: got none that fits another; wanted landmarks at their coordinates")
    return _finished(problem, unknowns, kept, rejected)


def _solve(problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, *, robust: bool) -> FloatArray:
    for _ in range(_ROBUST_ROUNDS if robust else _FINAL_ROUNDS):
        weighted = _Weighted(problem=problem, whitening=_whitening(problem, unknowns), kept=kept)
        found = least_squares(
            weighted.residual,
            unknowns,
            jac=weighted.jacobian,
            loss="soft_l1" if robust else "linear",
            f_scale=_BEND_SIGMA,
            xtol=1e-10,
            max_nfev=60,
        )
        unknowns = np.asarray(found.x, dtype=np.float64)
    return unknowns


def _whitening(problem: LandmarkProblem, unknowns: FloatArray) -> FloatArray:
    """Return W (n, 2, 2): W r has unit covariance, noise of pixel and of angle readings together."""
    by_angle = problem.evaluate(unknowns).by_angle
    pixel, angle = problem.variances
    noise = pixel[:, None, None] * np.eye(2) + angle[:, None, None] * by_angle @ np.swapaxes(by_angle, 1, 2)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(noise)))


def _lengths(problem: LandmarkProblem, unknowns: FloatArray) -> FloatArray:
    """Return each look's residual (n,) in sigmas; infinite behind the camera."""
    seen = problem.evaluate(unknowns)
    off = np.einsum("nij,nj->ni", _whitening(problem, unknowns), seen.pixel_px - problem.pixel_px)
    return np.asarray(np.where(seen.usable, np.linalg.norm(off, axis=1), np.inf))


def _worst(
    problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, rejected: dict[str, float]
) -> tuple[dict[str, float], MaskArray]:
    """Return landmarks and looks (n,) to leave out next: beyond the limit, and not much better than the worst."""
    length = _lengths(problem, unknowns)
    scale = max(1.0, float(np.median(length[kept])) / _MEDIAN_LENGTH)
    shift = problem.spread @ unknowns
    off = {}
    for landmark in problem.landmarks:
        places = problem.places(f"landmark {landmark.name}")
        if landmark.name in rejected or not places:
            continue
        sigma = np.where(landmark.sigma > 0.0, landmark.sigma, np.inf)
        off[landmark.name] = float(np.linalg.norm(shift[places] / sigma))
    # what a wrong coordinate does not take up is spread over its looks: the landmark goes first
    worst = max([*off.values(), *(length[kept] / scale)])
    limit = max(GROSS_SIGMA, 0.5 * worst)
    landmarks = {name: value for name, value in off.items() if value > limit}
    return landmarks, kept & (length / scale > limit)


def _of_landmarks(problem: LandmarkProblem, names: dict[str, float]) -> MaskArray:
    """Return which looks (n,) are of some landmarks."""
    gone = [k for k, landmark in enumerate(problem.landmarks) if landmark.name in names]
    return np.concatenate([np.isin(looks.landmark, gone) for looks in problem.looks])


def _finished(
    problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, rejected: dict[str, float]
) -> LandmarkFit:
    whitening = _whitening(problem, unknowns)
    weighted = _Weighted(problem=problem, whitening=whitening, kept=kept)
    residual, jacobian = weighted.residual(unknowns), weighted.jacobian(unknowns)
    information = jacobian.T @ jacobian
    chi_square, freedom = float(residual @ residual), len(residual) - len(unknowns)
    misfit = freedom > 0 and chi_square > chi2.ppf(1.0 - _MISFIT_PROBABILITY, freedom)
    raised = float(np.sqrt(chi_square / freedom)) if misfit else 1.0
    return LandmarkFit(
        problem=problem,
        unknowns=unknowns,
        change=problem.spread @ unknowns,
        covariance=problem.spread @ inverted(information) @ problem.spread.T * raised**2,
        information=information,
        kept=kept,
        length=_lengths(problem, unknowns),
        residual_px=problem.evaluate(unknowns).pixel_px - problem.pixel_px,
        rejected_landmarks=rejected,
        chi_square=chi_square,
        freedom=freedom,
        raised=raised,
    )


def inverted(information: FloatArray) -> FloatArray:
    """Return the inverse of an information (q, q); where nothing is known, a variance far beyond all others."""
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, _LEAST_INFORMATION * max(float(values.max()), 1e-300))
    return np.asarray(vectors / values @ vectors.T)


def information_with(
    problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, *, pixel: float = 1.0, angle: float = 1.0
) -> FloatArray:
    """Return the information (q, q) that the same looks would give with other noise: factors on the variances."""
    seen = problem.evaluate(unknowns)
    by_pixel, by_angle = problem.variances
    noise = pixel * by_pixel[:, None, None] * np.eye(2)
    noise = noise + angle * by_angle[:, None, None] * seen.by_angle @ np.swapaxes(seen.by_angle, 1, 2)
    use = kept & seen.usable
    gain = np.swapaxes(seen.jacobian[use], 1, 2) @ np.linalg.inv(noise[use])
    return np.asarray((gain @ seen.jacobian[use]).sum(axis=0) + np.diag(problem.known.astype(np.float64)))
