"""Update with a PTU reading: the pan and tilt angles of a station, in the PTU's own clock."""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.imm import ImmArrays, ImmState, correct_modes
from groundstation.estimation.kalman_kernels import BoolArray, LinearMeasurement, innovation_covariance
from groundstation.estimation.state_model import StateLayout
from groundstation.estimation.updates.measurements import EncoderReading
from groundstation.estimation.updates.update import (
    CorrectedModes,
    LinearPrediction,
    PredictedState,
    Update,
    VarianceInflation,
)
from groundstation.geometry.angles import wrap_rad
from groundstation.geometry.mahalanobis import mahalanobis_squared
from groundstation.messages import Innovation


class EncoderUpdate:
    """Update with the readings of one station's PTU.

    Parameters
    ----------
    layout : of the state.
    station : name of the turning station.
    config : of the filter.
    """

    def __init__(self, layout: StateLayout, station: str, config: EstimationConfig) -> None:
        self._size = layout.size
        self._angles, self._rates = layout.angles[station], layout.rates[station]
        self._gate_sigma, self._psd = config.encoder_gate_sigma, config.ptu_acceleration_psd_rad2_s3
        self._carries_clock = f"{station}.ptu_clock.offset" in layout.parameters

    def reading(
        self, angles_rad: tuple[float, float], sigma_rad: float, clock_sigma_s: float, ahead_s: float
    ) -> EncoderReading:
        """Return a reading with its noise; ``clock_sigma_s`` is noise unless the clock error is a state."""
        variance = sigma_rad**2 + self._psd * abs(ahead_s) ** 3 / 3.0
        return EncoderReading(*angles_rad, ahead_s, variance, 0.0 if self._carries_clock else clock_sigma_s)

    def __call__(self, state: PredictedState, reading: EncoderReading) -> Update:
        """Return the update; a reading outside the gate inflates the angle variances by its squared residual.

        The next reading decides whether a rejected one was an outlier or a jerk of the PTU.
        """
        residual, S = np.empty(2), np.empty((2, 2))
        corrected = ImmState.empty(*state.imm.states.shape)
        at, rate = self._angles.start, self._rates.start
        nis, accepted = _correct_angles(
            tuple(state.imm),
            at,
            rate,
            tuple(reading),
            self._gate_sigma,
            state.estimated,
            residual,
            S,
            tuple(corrected),
        )
        innovation = Innovation(residual=residual, covariance=S, nis=nis, dof=2, accepted=accepted)
        if accepted:
            return Update(innovation, CorrectedModes(imm=corrected))
        return Update(innovation, VarianceInflation(part=self._angles, variances=residual**2))

    def predict(self, x: FloatArray, ahead_s: float) -> LinearPrediction:
        """Return pan and tilt (2,) of a reading valid ``ahead_s`` after the time of the state (n,)."""
        H = np.zeros((2, self._size))
        angle, rate = self._angles.start, self._rates.start
        H[0, angle] = H[1, angle + 1] = 1.0
        H[0, rate] = H[1, rate + 1] = ahead_s
        return LinearPrediction(value=x[self._angles] + ahead_s * x[self._rates], jacobian=H)

    def nis(self, x: FloatArray, P: FloatArray, reading: EncoderReading) -> float:
        """Return the normalised innovation squared of a reading, without an update."""
        expected = self.predict(x, reading.ahead_s)
        measured = (reading.pan_rad, reading.tilt_rad)
        residual = np.array([wrap_rad(a - b) for a, b in zip(measured, expected.value, strict=True)])
        R = np.diag(reading.variance_rad2 + (reading.clock_sigma_s * x[self._rates]) ** 2)
        return float(mahalanobis_squared(residual, innovation_covariance(P, expected.jacobian, R)))


@njit(cache=True)
def _correct_angles(
    before: ImmArrays,
    angle: int,
    rate: int,
    angles: tuple[float, ...],
    gate_sigma: float,
    estimated: BoolArray,
    residual: FloatArray,
    S: FloatArray,
    after: ImmArrays,
) -> tuple[float, bool]:
    """Write residual and S of a reading and, inside the gate, the corrected modes; return NIS and acceptance.

    ``angle`` and ``rate`` are the indices of the pan states; those of tilt follow. ``angles`` are an `EncoderReading`.
    """
    state, reading, corrected = ImmState(*before), EncoderReading(*angles), ImmState(*after)
    x, P = state.mean, state.covariance
    H, R = np.zeros((2, x.size)), np.zeros((2, 2))
    inside = True
    for k in range(2):
        H[k, angle + k], H[k, rate + k] = 1.0, reading.ahead_s
        measured = reading.pan_rad if k == 0 else reading.tilt_rad
        off = measured - (x[angle + k] + reading.ahead_s * x[rate + k])
        residual[k] = (off + np.pi) % (2.0 * np.pi) - np.pi
        R[k, k] = reading.variance_rad2 + (reading.clock_sigma_s * x[rate + k]) ** 2
    # S = H P Hᵀ + R with H = [I, ahead·I] in the columns of angles and rates
    for a in range(2):
        for b in range(2):
            by_angle = P[angle + a, angle + b] + P[angle + a, rate + b] * reading.ahead_s
            by_rate = P[rate + a, angle + b] + P[rate + a, rate + b] * reading.ahead_s
            S[a, b] = R[a, b] + by_angle + reading.ahead_s * by_rate
    for k in range(2):
        inside &= residual[k] ** 2 <= gate_sigma**2 * S[k, k]
    if inside:
        correct_modes(state, LinearMeasurement(residual, H, R), estimated, 1.0, False, corrected)
    return mahalanobis_squared(residual, S), inside
