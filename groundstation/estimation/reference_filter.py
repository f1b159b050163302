"""Plain filter with filterpy's own arithmetic, against which the compiled kernels are tested; slow.

`ExtendedKalmanFilter` predicts and corrects one mode. filterpy is Labbe's library of textbook filters.
"""

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from groundstation.arrays import FloatArray
from groundstation.estimation.kalman_kernels import LinearMeasurement


class ReferenceFilter:
    """One mode: state ``x`` (n,) with covariance ``P`` (n, n)."""

    def __init__(self, x: FloatArray, P: FloatArray, measured: int = 2) -> None:
        self._ekf = ExtendedKalmanFilter(dim_x=x.size, dim_z=measured)
        self._ekf.x, self._ekf.P = x.copy(), P.copy()

    @property
    def x(self) -> FloatArray:
        """The state (n,)."""
        return np.asarray(self._ekf.x)

    @property
    def P(self) -> FloatArray:  # noqa: N802 - as in every filter equation
        """The covariance (n, n)."""
        return np.asarray(self._ekf.P)

    @property
    def K(self) -> FloatArray:  # noqa: N802 - as in every filter equation
        """The gain (n, m) of the last update."""
        return np.asarray(self._ekf.K)

    @property
    def S(self) -> FloatArray:  # noqa: N802 - as in every filter equation
        """The innovation covariance (m, m) of the last update."""
        return np.asarray(self._ekf.S)

    def predict(self, F: FloatArray, Q: FloatArray) -> None:
        """Predict with transition (n, n) and process noise (n, n)."""
        self._ekf.F, self._ekf.Q = F, Q
        self._ekf.predict()

    def correct(self, measurement: LinearMeasurement) -> None:
        """Update with a linearised measurement (m,)."""
        residual, H, R = measurement
        predicted = H @ self._ekf.x
        self._ekf.update(predicted + residual, lambda _: H, lambda _: predicted, R=R)
