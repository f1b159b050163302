"""Update with a PTU reading in plain numpy, for a filter without compiled kernels."""

import numpy as np

from groundstation.estimation.kalman_kernels import LinearMeasurement
from groundstation.estimation.updates.encoder_update import EncoderUpdate
from groundstation.estimation.updates.measurements import EncoderReading
from groundstation.estimation.updates.update import LinearCorrection, PredictedState, Update, VarianceInflation
from groundstation.geometry.angles import wrap_rad
from groundstation.messages import Innovation


class NumpyEncoderUpdate(EncoderUpdate):
    """Update with the readings of one station's PTU, that leaves the correction of the modes to the filter."""

    def __call__(self, state: PredictedState, reading: EncoderReading) -> Update:
        """Return the update; a reading outside the gate inflates the angle variances by its squared residual."""
        expected = self.predict(state.x, reading.ahead_s)
        H, angles = expected.jacobian, (reading.pan_rad, reading.tilt_rad)
        residual = np.array([wrap_rad(a - b) for a, b in zip(angles, expected.value, strict=True)])
        R = np.diag(reading.variance_rad2 + (reading.clock_sigma_s * state.x[self._rates]) ** 2)
        S = H @ state.P @ H.T + R
        nis = float(residual @ np.linalg.solve(S, residual))
        accepted = bool(np.all(residual**2 <= self._gate_sigma**2 * np.diag(S)))
        innovation = Innovation(residual=residual, covariance=S, nis=nis, dof=2, accepted=accepted)
        if not accepted:
            return Update(innovation, VarianceInflation(part=self._angles, variances=residual**2))
        linear = LinearMeasurement(residual, H, R)
        return Update(
            innovation, LinearCorrection(measurement=linear, updates_weights=False, estimated=state.estimated)
        )
