"""Robust nonlinear least squares: the one fit of flight, mount and landmark calibration.

    min_x ½ Σ c² ρ(rᵢ(x)²/c²),    r = (residuals in sigmas, x / prior sigma)

with ρ(z) = z, or ρ(z) = 2 (√(1 + z) − 1) (soft-L1: quadratic below c sigmas, linear above). The noise of an observation
may depend on the solution. `fit_reweighted` therefore alternates between new weights at the newest solution and a fit
with these weights held (iteratively reweighted least squares).

The trust-region steps are those of `scipy.optimize.least_squares`. It takes the singular values of the whole Jacobian
in each step: 145 ms for 20,000 × 40, more than the observations' prediction takes. It is therefore given the triangle R
of the QR decomposition of [√ρ′ J, √ρ′ r], which has the same cost, gradient and Gauss-Newton matrix JᵀWJ with
W = diag ρ′ and takes 20 ms. The steps with the squared loss stay the same.

The last column of R above its last row is the Gauss-Newton step in sigmas of the solution (the square root of the
Newton decrement). The fit ends where that is negligible. SciPy's own tolerances are relative to the cost and to the
parameters: near the solution the cost changes by less than its rounding errors, and two thirds of the evaluations of a
mount's fits (tests/calibration/mount) were steps that were tried, refused and shortened, until one was short enough.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares

from calibration.information import inverse
from groundstation.arrays import FloatArray, MaskArray

# c of soft-L1, sigmas
SOFT_L1_SIGMA = 1.5
# of the length of a two-dimensional standard normal residual: its median, and what one in 25,000 exceeds
MEDIAN_LENGTH = 1.1774
OUTLIER_SIGMA = 4.5
_MOST_EVALUATIONS = 60
_STEP_TOLERANCE = 1e-10
# a Gauss-Newton step that is so much shorter than the solution's own sigma ends a fit: chosen, a hundredth of the 0.01
# sigma in which no stated figure shows, for the loss lets some steps shorten the way by less than all of it
_SETTLED_SIGMA = 1e-4


class Loss(StrEnum):
    """Loss function ρ."""

    SQUARED = "squared"
    SOFT_L1 = "soft-L1"


class LinearisedPixels(Protocol):
    """Predicted pixels of n observations and their derivatives by p parameters."""

    @property
    def pixel_px(self) -> FloatArray:
        """Pixels (n, 2)."""
        ...

    @property
    def jacobian(self) -> FloatArray:
        """Their derivatives (n, 2, p)."""
        ...

    @property
    def usable(self) -> MaskArray:
        """Observations (n,) that can be predicted: the point is in front of the camera."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Linearisation:
    """Residuals (m,) in sigmas at one point and their ``jacobian`` (m, p)."""

    residual: FloatArray
    jacobian: FloatArray

    @property
    def information(self) -> FloatArray:
        """JᵀJ (p, p)."""
        return np.asarray(self.jacobian.T @ self.jacobian)

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residual @ self.residual)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitProblem:
    """The problem to minimise.

    Attributes
    ----------
    evaluate : residuals of the observations in sigmas and their Jacobian at parameters (p,).
    prior_sigma : (p,) of normal priors with mean zero; infinite without a prior. The loss applies to them, too.
    step_scale : (p,) typical steps of the parameters, which shape the trust region.
    loss : of all residuals.
    """

    evaluate: Callable[[FloatArray], Linearisation]
    prior_sigma: FloatArray
    step_scale: FloatArray
    loss: Loss = Loss.SQUARED

    def linearise(self, parameters: FloatArray) -> Linearisation:
        """Return the residuals of observations and, behind them, of priors."""
        observed = self.evaluate(parameters)
        known = np.isfinite(self.prior_sigma)
        return Linearisation(
            residual=np.concatenate([observed.residual, (parameters / self.prior_sigma)[known]]),
            jacobian=np.concatenate([observed.jacobian, np.diag(1.0 / self.prior_sigma)[known]]),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitSolution:
    """Parameters (p,) of least cost.

    Attributes
    ----------
    linearisation : residuals of observations and priors there, and their Jacobian.
    weights : (m,) of these residuals, ρ′: 1 with the squared loss.
    iterations : evaluations of the problem.
    converged : False where these were used up.
    """

    parameters: FloatArray
    linearisation: Linearisation
    weights: FloatArray
    iterations: int
    converged: bool

    @property
    def information(self) -> FloatArray:
        """JᵀWJ (p, p), priors included."""
        jacobian = self.linearisation.jacobian
        return np.asarray(jacobian.T @ (self.weights[:, None] * jacobian))

    @property
    def covariance(self) -> FloatArray:
        """(JᵀWJ)⁻¹ (p, p)."""
        return inverse(self.information)


class _SettledError(Exception):
    """The parameters that SciPy asks a Jacobian for are the solution, which it has no other way to be told (1.13)."""


@dataclass(slots=True, eq=False)
class _Triangle:
    """The problem as SciPy is given it: R of the weighted [J, r], computed once for each point.

    ``evaluations`` counts the points.
    """

    problem: FitProblem
    evaluations: int = 0
    _at: bytes = b""
    _linearisation: Linearisation | None = None
    _rows: FloatArray = field(default_factory=lambda: np.zeros((0, 1)))

    def residual(self, parameters: FloatArray) -> FloatArray:
        """Return Qᵀr and, in the last row, the remainder of the cost."""
        self.linearise(parameters)
        return self._rows[:, -1]

    def jacobian(self, parameters: FloatArray) -> FloatArray:
        """Return R above a row of zeros; raises `_SettledError` where a further step would be negligible.

        SciPy asks for the Jacobian only at points that it has accepted.
        """
        self.linearise(parameters)
        if float(np.linalg.norm(self._rows[: len(parameters), -1])) < _SETTLED_SIGMA:
            raise _SettledError
        return self._rows[:, :-1]

    @property
    def newest(self) -> FloatArray:
        """Return the parameters (p,) of the newest point."""
        return np.frombuffer(self._at, dtype=np.float64).copy()

    def linearise(self, parameters: FloatArray) -> Linearisation:
        """Return the problem's own residuals and Jacobian."""
        if self._linearisation is not None and parameters.tobytes() == self._at:
            return self._linearisation
        at, loss = self.problem.linearise(parameters), self.problem.loss
        rows = np.column_stack([at.jacobian, at.residual]) * np.sqrt(_weights(at.residual, loss))[:, None]
        # ρ is concave, so that z ρ′(z) ≤ ρ(z)
        beyond = max(_twice_cost(at.residual, loss) - float(rows[:, -1] @ rows[:, -1]), 0.0)
        last = np.zeros((1, rows.shape[1]))
        last[0, -1] = np.sqrt(beyond)
        self._rows = np.concatenate([np.linalg.qr(rows, mode="r"), last])
        self._at, self._linearisation = parameters.tobytes(), at
        self.evaluations += 1
        return at


def minimise(problem: FitProblem, start: FloatArray, most_evaluations: int = _MOST_EVALUATIONS) -> FitSolution:
    """Find the parameters of least cost from a start (p,)."""
    triangle = _Triangle(problem)
    parameters, converged = start, True
    if len(start):
        try:
            found = least_squares(
                triangle.residual,
                start,
                jac=triangle.jacobian,
                x_scale=problem.step_scale,
                xtol=_STEP_TOLERANCE,
                max_nfev=most_evaluations,
            )
        except _SettledError:
            parameters = triangle.newest
        else:
            parameters, converged = np.asarray(found.x, dtype=np.float64), bool(found.status > 0)
    iterations = triangle.evaluations
    at = triangle.linearise(parameters)
    return FitSolution(
        parameters=parameters,
        linearisation=at,
        weights=_weights(at.residual, problem.loss),
        iterations=iterations,
        converged=converged,
    )


def fit_reweighted(
    weighted_at: Callable[[FloatArray], FitProblem | None],
    start: FloatArray,
    rounds: int,
    most_evaluations: int = _MOST_EVALUATIONS,
) -> FloatArray:
    """Return the parameters (p,) after rounds of new weights and a fit with them.

    ``weighted_at`` returns the problem with weights and outliers at parameters (p,), or None to end before
    the last round: the weights are those of the last fit.
    """
    parameters = start
    for _ in range(rounds):
        problem = weighted_at(parameters)
        if problem is None:
            break
        parameters = minimise(problem, parameters, most_evaluations).parameters
    return parameters


def pixel_linearisation(
    predicted: LinearisedPixels, seen_px: FloatArray, whitening: FloatArray, kept: MaskArray
) -> Linearisation:
    """Return whitened residuals (2k,) of the k kept pixels; one that has become unusable gets weight zero.

    ``seen_px`` (n, 2), ``whitening`` (n, 2, 2), ``kept`` (n,).
    """
    white = whitening[kept] * predicted.usable[kept, None, None]
    off = (predicted.pixel_px - seen_px)[kept]
    jacobian = predicted.jacobian[kept]
    return Linearisation(
        residual=np.einsum("nij,nj->ni", white, off).ravel(),
        jacobian=(white @ jacobian).reshape(-1, jacobian.shape[-1]),
    )


def stacked(parts: list[Linearisation]) -> Linearisation:
    """Return several groups of residuals of the same parameters as one."""
    return Linearisation(
        residual=np.concatenate([part.residual for part in parts]),
        jacobian=np.concatenate([part.jacobian for part in parts]),
    )


def whitening_of(covariance: FloatArray) -> FloatArray:
    """Return W (n, k, k) with W S Wᵀ = I for covariances S (n, k, k)."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))


def whitened_length(off: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the length (n,) in sigmas of residuals (n, 2) with covariances (n, 2, 2)."""
    return np.asarray(np.linalg.norm(np.einsum("nij,nj->ni", whitening_of(covariance), off), axis=1))


def noise_factor(length: FloatArray, least: float = 1.0) -> float:
    """Return the noise found over that assumed by the median of whitened lengths (n,), not below ``least``."""
    return max(float(np.median(length)) / MEDIAN_LENGTH, least) if len(length) else least


def _weights(residual: FloatArray, loss: Loss) -> FloatArray:
    """Return ρ′ (m,)."""
    if loss is Loss.SQUARED:
        return np.ones(len(residual))
    return np.asarray(1.0 / np.sqrt(1.0 + (residual / SOFT_L1_SIGMA) ** 2))


def _twice_cost(residual: FloatArray, loss: Loss) -> float:
    if loss is Loss.SQUARED:
        return float(residual @ residual)
    root = np.sqrt(1.0 + (residual / SOFT_L1_SIGMA) ** 2)
    return float(2.0 * SOFT_L1_SIGMA**2 * np.sum(root - 1.0))
