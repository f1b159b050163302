"""One smooth motion of a head that its readings and its camera's pictures both have seen, for trial clocks.

Pan and tilt are cubic splines of time; the readings are values of them, the pictures differences of them at later or
earlier times, through a small scale and roll of the camera. For each offset, drift, scale and roll the splines' least
squares are linear and are solved on the way (variable projection).
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.linalg import LinAlgError
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import least_squares
from scipy.sparse import bmat, csr_matrix, diags

from calibration.clocks.image_motion import ImageMotion
from groundstation.arrays import FloatArray, MaskArray

CUBIC = 3
# nothing but a guard against stretches without a reading
_STIFFNESS = 1e-5
# added to the diagonal, shares of its mean: the least with which there are factors, as rounding errors may be negative
_HELD = (1e-12, 1e-9, 1e-6)
# one sigma before: of a lens's scale, of a camera's roll in rad, of a quartz
SCALE_SIGMA = 0.02
ROLL_SIGMA_RAD = float(np.radians(2.0))
DRIFT_SIGMA = 2e-4
# the scale of each parameter: offset in s, drift, scale, roll in rad
_STEPS = np.array([1e-4, 1e-6, 1e-4, 1e-4])


@dataclass(slots=True, eq=False)
class MotionSpline:
    """Data and weights; gives the residuals for each (offset, drift, scale, roll)."""

    readings: FloatArray
    motion: ImageMotion
    knots: FloatArray
    weight_reading: float
    weight_turn: FloatArray
    middle_s: float
    with_drift: bool

    def __post_init__(self) -> None:
        self._basis = self._at(self.readings[:, 0])
        count = self._basis.shape[1]
        bend = diags([1.0, -2.0, 1.0], [0, 1, 2], shape=(count - 2, count)).tocsr()
        self._stiff = _STIFFNESS * bend

    _basis: csr_matrix = None
    _stiff: csr_matrix = None
    _last: "_SplineSolution | None" = None

    def _inside(self, t_s: FloatArray) -> FloatArray:
        return np.clip(t_s, self.knots[CUBIC], self.knots[-CUBIC - 1] - 1e-9)

    def _at(self, t_s: FloatArray) -> csr_matrix:
        return BSpline.design_matrix(self._inside(t_s), self.knots, CUBIC).tocsr()

    def _times(self, t_s: FloatArray, p: FloatArray) -> FloatArray:
        """Return the PTU's times (n,) of instants of the session."""
        return np.asarray(t_s - p[0] - p[1] * (t_s - self.middle_s))

    def matrices(self, p: FloatArray) -> tuple[csr_matrix, FloatArray]:
        """Return the weighted design of the splines' coefficients and the weighted data, behind the rest."""
        _, _, scale, roll = p
        motion = self.motion
        turn = self._at(self._times(motion.to_s, p)) - self._at(self._times(motion.from_s, p))
        w = self.weight_reading
        wp, wt = (diags(self.weight_turn[:, k]) for k in (0, 1))
        s = 1.0 + scale
        design = bmat(
            [
                [w * self._basis, None],
                [None, w * self._basis],
                [wp @ turn * s, wp @ turn * (-roll * s)],
                [wt @ turn * (roll * s), wt @ turn * s],
                [w * self._stiff, None],
                [None, w * self._stiff],
            ]
        ).tocsc()
        data = np.concatenate(
            [
                w * self.readings[:, 1],
                w * self.readings[:, 2],
                self.weight_turn[:, 0] * motion.turn_rad[:, 0],
                self.weight_turn[:, 1] * motion.turn_rad[:, 1],
                np.zeros(2 * self._stiff.shape[0]),
            ]
        )
        return design, data

    def _solution(self, p: FloatArray) -> "_SplineSolution":
        """Return the splines that fit best at four parameters; the last result is cached."""
        if self._last is None or not np.array_equal(self._last.p, p):
            design, data = self.matrices(p)
            factors = _BandFactors(design)
            coefficients = np.asarray(factors.solve(design.T @ data))
            self._last = _SplineSolution(p.copy(), design, data, factors, coefficients)
        return self._last

    def residual(self, p: FloatArray) -> FloatArray:
        """Return the weighted residuals: readings' pan and tilt, turns' pan and tilt, then the rest."""
        at = self._solution(p)
        return np.asarray(at.design @ at.coefficients - at.data)

    def freedom(self, p: FloatArray) -> tuple[float, float]:
        """Return how many parameters the readings and the turns each pay for."""
        at = self._solution(p)
        design = at.design
        n = 2 * len(self.readings)
        parts = design[:n], design[n : n + 2 * len(self.motion.from_s)]
        inverse = at.factors.inverse()
        taken = [float(np.sum((part.T @ part).multiply(inverse.T))) for part in parts]
        return taken[0], taken[1]

    def solve(self, start: FloatArray) -> FloatArray:
        """Return the parameters (4,) from a start (4,)."""
        prior, free = self.prior(), self.free()

        def at(x: FloatArray) -> FloatArray:
            p = start.copy()
            p[free] += x * _STEPS[free]
            return p

        # differences from the initial values: a trust region begins with their size
        found = least_squares(
            lambda x: np.concatenate([self.residual(at(x)), at(x)[free] / prior[free]]),
            np.zeros(int(free.sum())),
            jac=lambda x: np.concatenate(
                [self.jacobian(at(x))[:, free] * _STEPS[free], np.diag(_STEPS[free] / prior[free])]
            ),
            ftol=1e-7,
            xtol=1e-5,
            max_nfev=60,
        )
        return at(np.asarray(found.x))

    def free(self) -> MaskArray:
        """Return which of the four parameters are sought."""
        return np.array([True, self.with_drift, True, True])

    def prior(self) -> FloatArray:
        """Return one sigma before of the four parameters; a drift that is not sought is exact."""
        return np.array([1e3, DRIFT_SIGMA if self.with_drift else 1e-12, SCALE_SIGMA, ROLL_SIGMA_RAD])

    def jacobian(self, p: FloatArray) -> FloatArray:
        """Return the derivatives (n, 4) of `residual`, without the part that vanishes with the residuals (Kaufman)."""
        at = self._solution(p)
        n, m = len(self.readings), len(self.motion.from_s)
        scale, roll = 1.0 + p[2], p[3]
        halves = np.split(at.coefficients, 2)
        curves = [BSpline(self.knots, half, CUBIC) for half in halves]
        by_offset, by_drift, turn = np.zeros((2, m)), np.zeros((2, m)), np.zeros((2, m))
        for sign, stamps in ((-1.0, self.motion.from_s), (1.0, self.motion.to_s)):
            inside = self._inside(self._times(stamps, p))
            for axis, curve in enumerate(curves):
                rate = curve(inside, nu=1)
                by_offset[axis] -= sign * rate
                by_drift[axis] -= sign * rate * (stamps - self.middle_s)
                turn[axis] += sign * curve(inside)
        mix = scale * np.array([[1.0, -roll], [roll, 1.0]])
        columns = np.zeros((len(at.data), 4))
        parts = (mix @ by_offset, mix @ by_drift, mix @ turn / scale, scale * np.array([-turn[1], turn[0]]))
        for k, part in enumerate(parts):
            if self.free()[k]:
                moved = np.zeros(len(at.data))
                moved[2 * n : 2 * n + 2 * m] = (part * self.weight_turn.T).ravel()
                columns[:, k] = moved - at.design @ at.factors.solve(at.design.T @ moved)
        return columns


@dataclass(frozen=True, slots=True, eq=False)
class _SplineSolution:
    p: FloatArray
    design: csr_matrix
    data: FloatArray
    factors: "_BandFactors"
    coefficients: FloatArray


def _factors(band: FloatArray) -> FloatArray:
    """Return the Cholesky factors of a lower band (w, n); what no data determine is held near zero."""
    for share in _HELD:
        held = band.copy()
        held[0] += share * band[0].mean()
        with suppress(LinAlgError):
            return np.asarray(cholesky_banded(held, overwrite_ab=True, lower=True, check_finite=False))
    raise AssertionError("the last share is far above rounding errors")


class _BandFactors:
    """Cholesky factors of the normal equations of two splines of k coefficients, (2k, 2k).

    With the coefficients of both in turns they are a band: of 882 coefficients its factors take 1.7 ms where those of
    a sparse matrix take 3.5, and its inverse 47 ms where that of a full matrix takes 198 (2026-11, one core).
    """

    def __init__(self, design: csr_matrix) -> None:
        normal = (design.T @ design).tocoo()
        size = normal.shape[0]
        self._turns = np.arange(size).reshape(2, -1).T.ravel()
        place = np.empty(size, dtype=np.int64)
        place[self._turns] = np.arange(size)
        row, column = place[normal.row], place[normal.col]
        below = row >= column
        band = np.zeros((int((row - column).max()) + 1, size))
        band[(row - column)[below], column[below]] = normal.data[below]
        self._factors = _factors(band)

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the solution (2k,) or (2k, n) of right sides of that shape."""
        solved = np.empty(right.shape)
        solved[self._turns] = cho_solve_banded((self._factors, True), right[self._turns], check_finite=False)
        return solved

    def inverse(self) -> FloatArray:
        """Return the inverse of the normal equations."""
        return self.solve(np.eye(len(self._turns)))
