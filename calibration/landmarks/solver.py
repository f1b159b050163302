"""Least squares over stations and landmarks: residuals in sigmas, their Jacobian, one solution for given looks."""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares

from calibration.landmarks.problem import LandmarkProblem
from groundstation.arrays import FloatArray, MaskArray

# soft-L1 bends here, in sigmas
_BEND_SIGMA = 1.5
_ROBUST_ROUNDS = 3
_FINAL_ROUNDS = 2


@dataclass(slots=True, eq=False)
class Weighted:
    """Residuals and Jacobian of kept looks and of what was known, in sigmas; computed once for each point."""

    problem: LandmarkProblem
    whitening: FloatArray
    kept: MaskArray
    _at: bytes = b""
    _residual: FloatArray = field(default_factory=lambda: np.zeros(0))
    _jacobian: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def residual(self, unknowns: FloatArray) -> FloatArray:
        """Return the residuals (m,) at unknowns (q,)."""
        self._compute(unknowns)
        return self._residual

    def jacobian(self, unknowns: FloatArray) -> FloatArray:
        """Return their derivatives (m, q)."""
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


def solve_kept(problem: LandmarkProblem, unknowns: FloatArray, kept: MaskArray, *, robust: bool) -> FloatArray:
    """Return the unknowns (q,) for the kept looks (n,), from a start (q,); the noise is taken anew in each round."""
    for _ in range(_ROBUST_ROUNDS if robust else _FINAL_ROUNDS):
        weighted = Weighted(problem=problem, whitening=whitening_of(problem, unknowns), kept=kept)
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


def whitening_of(problem: LandmarkProblem, unknowns: FloatArray) -> FloatArray:
    """Return W (n, 2, 2): W r has unit covariance, noise of pixel and of angle readings together."""
    by_angle = problem.evaluate(unknowns).by_angle
    pixel, angle = problem.variances
    noise = pixel[:, None, None] * np.eye(2) + angle[:, None, None] * by_angle @ np.swapaxes(by_angle, 1, 2)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(noise)))


def white_residuals(problem: LandmarkProblem, unknowns: FloatArray) -> FloatArray:
    """Return each look's residual (n, 2) in sigmas; infinite behind the camera."""
    seen = problem.evaluate(unknowns)
    off = np.einsum("nij,nj->ni", whitening_of(problem, unknowns), seen.pixel_px - problem.pixel_px)
    return np.asarray(np.where(seen.usable[:, None], off, np.inf))
