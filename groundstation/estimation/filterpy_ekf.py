"""Extended Kalman filter of one mode, by filterpy's `ExtendedKalmanFilter` (Labbe's library of textbook filters).

Prediction, innovation covariance, gain, Joseph form and likelihood are filterpy's. It has no consider parameters and no
share of a gain: where a measurement needs one, filterpy's gain is limited and its Joseph form, which holds for any
gain, is written out with it. Unlike the compiled kernels nothing is made symmetric afterwards.
"""

from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from groundstation.arrays import FloatArray
from groundstation.estimation.kalman_kernels import BoolArray, LinearMeasurement


class FilterpyEkf(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """One mode with state ``x`` (n,), covariance ``P`` (n, n); after an update gain ``K`` (n, m) and ``S`` (m, m).

    `predict` and `update` have the arguments that `filterpy.kalman.IMMEstimator` calls them with.
    """

    def __init__(self, x: FloatArray, P: FloatArray) -> None:
        super().__init__(dim_x=x.size, dim_z=1)
        self.x, self.P = x.copy(), P.copy()
        self._measurement: LinearMeasurement | None = None
        self._linearised_at = self.x
        self._estimated: BoolArray = np.ones(x.size, np.bool_)
        self._share = 1.0

    def set_motion(self, F: FloatArray, Q: FloatArray) -> None:
        """Set transition (n, n) and process noise (n, n) of the next predictions."""
        self.F, self.Q = F, Q

    def set_measurement(
        self,
        measurement: LinearMeasurement,
        linearised_at: FloatArray | None = None,
        estimated: BoolArray | None = None,
        share: float = 1.0,
    ) -> None:
        """Set the measurement of the next update, linearised at a state (n,), by default the present one.

        The gain is the optimal one times ``share``; it is zero for states that are not ``estimated`` (n,).
        """
        self._measurement = measurement
        self._linearised_at = self.x if linearised_at is None else linearised_at
        self._estimated = np.ones(self.x.size, np.bool_) if estimated is None else estimated
        self._share = share

    def predict(self, u: Any = None) -> None:
        """Predict by the motion that was set; ``u`` is no input of this filter."""
        super().predict(0.0 if u is None else u)

    def update(self, z: FloatArray) -> None:
        """Update with the residual ``z`` (m,) at the point of linearisation."""
        if self._measurement is None:
            raise ValueError("update before set_measurement")
        _, H, R = self._measurement
        x, P = self.x, self.P
        super().update(z, lambda _: H, lambda at: H @ (at - self._linearised_at), R=R)
        if self._share != 1.0 or not self._estimated.all():
            self.K: FloatArray = np.where(self._estimated[:, None], self._share * self.K, 0.0)
            rest = np.eye(x.size) - self.K @ H
            self.x, self.P = x + self.K @ self.y, rest @ P @ rest.T + self.K @ R @ self.K.T
