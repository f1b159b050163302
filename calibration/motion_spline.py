"""One smooth motion of a head that its readings and its camera's pictures both have seen, for trial clocks.

Pan and tilt are cubic splines of time; the readings are values of them, the pictures differences of them at later or
earlier times, through a small scale and roll of the camera. For each offset, drift, scale and roll the splines' least
squares are linear and are solved on the way (variable projection).
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import least_squares
from scipy.sparse import bmat, csr_matrix, diags, identity
from scipy.sparse.linalg import SuperLU, splu

from calibration.image_motion import ImageMotion
from groundstation.arrays import FloatArray, MaskArray

CUBIC = 3
# nothing but a guard against stretches without a reading
_STIFFNESS = 1e-5
# one sigma before: of a lens's scale, of a camera's roll in rad, of a quartz
SCALE_SIGMA = 0.02
ROLL_SIGMA_RAD = float(np.radians(2.0))
DRIFT_SIGMA = 2e-4
# of numeric derivatives, and the scale of each parameter: offset in s, drift, scale, roll in rad
_STEPS = np.array([1e-4, 1e-6, 1e-4, 1e-4])


@dataclass(slots=True, eq=False)
class MotionSpline:
    """Data and weights; answers each (offset, drift, scale, roll) with what is left over."""

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

    def _at(self, t_s: FloatArray) -> csr_matrix:
        inside = np.clip(t_s, self.knots[CUBIC], self.knots[-CUBIC - 1] - 1e-9)
        return BSpline.design_matrix(inside, self.knots, CUBIC).tocsr()

    def matrices(self, p: FloatArray) -> tuple[csr_matrix, FloatArray]:
        """Return the weighted design of the splines' coefficients and the weighted data, behind the rest."""
        offset, drift, scale, roll = p
        motion = self.motion
        times = []
        for t in (motion.from_s, motion.to_s):
            times.append(t - offset - drift * (t - self.middle_s))
        turn = self._at(times[1]) - self._at(times[0])
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

    def left_over(self, p: FloatArray) -> FloatArray:
        """Return the weighted residuals: readings' pan and tilt, turns' pan and tilt, then the rest."""
        design, data = self.matrices(p)
        return np.asarray(design @ _factors(design).solve(design.T @ data) - data)

    def freedom(self, p: FloatArray) -> tuple[float, float]:
        """Return how many parameters the readings and the turns each pay for."""
        design, _ = self.matrices(p)
        n = 2 * len(self.readings)
        parts = design[:n], design[n : n + 2 * len(self.motion.from_s)]
        normal = (design.T @ design).toarray()
        inverse = np.linalg.inv(normal + 1e-12 * np.trace(normal) / len(normal) * np.eye(len(normal)))
        taken = [float(np.sum((part.T @ part).multiply(inverse.T))) for part in parts]
        return taken[0], taken[1]

    def solve(self, start: FloatArray) -> FloatArray:
        """Return the parameters (4,) from a start (4,)."""
        prior, free = self.prior(), self.free()

        def at(x: FloatArray) -> FloatArray:
            p = start.copy()
            p[free] += x * _STEPS[free]
            return p

        # differences from the start: a trust region begins with the size of what it starts from
        found = least_squares(
            lambda x: np.concatenate([self.left_over(at(x)), at(x)[free] / prior[free]]),
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
        """Return the derivatives (n, 4) of `left_over`, without the part that vanishes with the residuals (Kaufman)."""
        design, data = self.matrices(p)
        factors = _factors(design)
        coefficients = factors.solve(design.T @ data)
        columns = []
        for k, free in enumerate(self.free()):
            if not free:
                columns.append(np.zeros(len(data)))
                continue
            d = np.zeros(4)
            d[k] = _STEPS[k]
            moved = (self.matrices(p + d)[0] @ coefficients - self.matrices(p - d)[0] @ coefficients) / (
                2.0 * _STEPS[k]
            )
            columns.append(moved - design @ factors.solve(design.T @ moved))
        return np.stack(columns, axis=1)


def _factors(design: csr_matrix) -> SuperLU:
    """Return the factors of the normal equations."""
    normal = (design.T @ design).tocsc()
    return splu(normal + 1e-12 * normal.diagonal().mean() * identity(normal.shape[0], format="csc"))
