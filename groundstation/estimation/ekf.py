"""The extended Kalman filter over the aircraft and the PTUs, on filterpy's filter.

Every reading is an update of its own at its own time: an encoder reading of a station, a pixel of a camera.
Updates are in Joseph form. The paper's Section 4.2; its lost equations are written out in docs/derivation.md.
"""

import math
from collections.abc import Mapping

import numpy as np
from scipy.stats import chi2

from groundstation.arrays import FloatArray
from groundstation.estimation.compiled_filter import CompiledKalmanFilter, innovation_covariance
from groundstation.estimation.config import EstimationConfig, OutOfViewWeighting
from groundstation.estimation.field_of_view import paper_weight, probability_in_view
from groundstation.estimation.measurement import PixelPrediction, encoder_jacobian, predict_pixel
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.state import StateLayout, state_layout
from groundstation.geometry.angles import wrap_rad
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Innovation, Kinematics

# start of an axis that has been read once: it may turn at up to this rate (1 sigma)
_INITIAL_RATE_SIGMA_RAD_S = math.radians(20.0)


class StationEkf:
    """Filter over one target and the turning stations.

    Parameters
    ----------
    stations : geometry of every station by name.
    turning : names of the stations that have a PTU; their angles are states.
    config : tuning.

    The target's six states exist only after `start_target`; before it their covariance is zero and they take
    no part. Times are session seconds; the filter never goes back.
    """

    def __init__(
        self, stations: Mapping[str, StationGeometry], turning: tuple[str, ...], config: EstimationConfig
    ) -> None:
        self.layout: StateLayout = state_layout(turning)
        self.time_s: float | None = None
        self.has_target = False
        self._stations = stations
        self._config = config
        self._motion = MotionModel(self.layout, config.acceleration_psd_m2_s3, config.ptu_acceleration_psd_rad2_s3)
        self._gate = float(chi2.ppf(config.gate_probability, 2))
        self._filter = CompiledKalmanFilter(dim_x=self.layout.size, dim_z=2)
        self._filter.x = np.zeros(self.layout.size)
        self._filter.P = np.zeros((self.layout.size, self.layout.size))
        self._read: set[str] = set()

    # ------------------------------------------------------------------------------------------ state
    @property
    def state(self) -> FloatArray:
        """The state vector (n,), in the layout's order."""
        return self._filter.x

    @property
    def covariance(self) -> FloatArray:
        """The state's covariance (n, n)."""
        return self._filter.P

    def angles(self, station: str) -> tuple[float, float]:
        """Return (pan, tilt) in rad; zero for a fixed station."""
        where = self.layout.angles.get(station)
        if where is None:
            return 0.0, 0.0
        pan, tilt = self._filter.x[where]
        return float(pan), float(tilt)

    def start_target(
        self, position_m: FloatArray, velocity_m_s: FloatArray, covariance: FloatArray, age_s: float = 0.0
    ) -> None:
        """Begin a target: (3,), (3,) in the runway frame and covariance (6, 6), as of ``age_s`` before now."""
        target = self.layout.target
        self.drop_target()
        F = self._motion.transition(age_s)[target, target]
        self._filter.x[target] = F @ np.concatenate([position_m, velocity_m_s])
        self._filter.P[target, target] = F @ covariance @ F.T + self._motion.process_noise(age_s)[target, target]
        self.has_target = True

    def drop_target(self) -> None:
        """Forget the target; the PTUs' angles stay."""
        target = self.layout.target
        self._filter.x[target] = 0.0
        self._filter.P[target, :] = 0.0
        self._filter.P[:, target] = 0.0
        self.has_target = False

    def kinematics_at(self, t_s: float) -> Kinematics:
        """Return position, velocity and (6, 6) covariance at a time near the filter's own.

        Going back (a pair's mean stamp lies before its second exposure) adds process noise too: the filter
        does not keep what would be needed to take it away.
        """
        target = self.layout.target
        dt = t_s - (self.time_s if self.time_s is not None else t_s)
        F = self._motion.transition(dt)[target, target]
        Q = self._motion.process_noise(dt)[target, target]
        x = F @ self._filter.x[target]
        P = F @ self._filter.P[target, target] @ F.T + Q
        return Kinematics(position_runway_m=x[:3].copy(), velocity_runway_m_s=x[3:].copy(), covariance=0.5 * (P + P.T))

    # ------------------------------------------------------------------------------------- prediction
    def predict_to(self, t_s: float) -> None:
        """Carry the state forward to ``t_s``; an earlier time leaves it where it is."""
        if self.time_s is None:
            self.time_s = t_s
        dt = t_s - self.time_s
        if dt <= 0.0:
            return
        Q = self._motion.process_noise(dt)
        if not self.has_target:
            Q[self.layout.target, self.layout.target] = 0.0
        self._filter.F = self._motion.transition(dt)
        self._filter.Q = Q
        self._filter.predict()
        self.time_s = t_s

    def predict_pixel(self, station: str, row_dt_s: float = 0.0) -> PixelPrediction | None:
        """Return the target's predicted pixel in one camera now; None if behind it."""
        return predict_pixel(self.layout, self._stations[station], self._filter.x, row_dt_s)

    # ---------------------------------------------------------------------------------------- updates
    def update_encoder(
        self, station: str, angles_rad: tuple[float, float], sigma_rad: float, clock_sigma_s: float, ahead_s: float
    ) -> Innovation:
        """Fuse one reading of pan and tilt that was true ``ahead_s`` after the filter's time.

        A reading beyond the gate is not used; the angles' covariance is widened by what it disagrees, since
        either the reading is wrong or the PTU has jerked, and only the next reading can tell.
        """
        where, rates = self.layout.angles[station], self.layout.rates[station]
        x, P = self._filter.x, self._filter.P
        if station not in self._read:
            self.set_angles(station, angles_rad, (0.0, 0.0), sigma_rad)
            return Innovation(residual=np.zeros(2), covariance=np.eye(2) * sigma_rad**2, nis=0.0, dof=0, accepted=True)
        H = encoder_jacobian(self.layout, station, ahead_s)
        rate = x[rates]
        extra = self._config.ptu_acceleration_psd_rad2_s3 * abs(ahead_s) ** 3 / 3.0
        R = np.diag(sigma_rad**2 + extra + (clock_sigma_s * rate) ** 2)
        predicted = x[where] + ahead_s * rate
        residual = np.array([wrap_rad(angles_rad[k] - predicted[k]) for k in range(2)])
        S = innovation_covariance(P, H, R)
        nis = _squared_sigmas(residual, S)
        allowed = self._config.encoder_gate_sigma**2
        accepted = all(residual[k] ** 2 <= allowed * S[k, k] for k in range(2))
        if accepted:
            self._filter.correct(residual, H, R)
        else:
            diagonal = np.arange(where.start, where.stop)
            P[diagonal, diagonal] += residual**2
        return Innovation(residual=residual, covariance=S, nis=nis, dof=2, accepted=accepted)

    def set_angles(
        self, station: str, angles_rad: tuple[float, float], rates_rad_s: tuple[float, float], sigma_rad: float
    ) -> None:
        """Start one PTU's states anew from readings, with no memory of before."""
        where, rates = self.layout.angles[station], self.layout.rates[station]
        for part, value, sigma in (
            (where, angles_rad, sigma_rad),
            (rates, rates_rad_s, _INITIAL_RATE_SIGMA_RAD_S),
        ):
            self._filter.P[part, :] = 0.0
            self._filter.P[:, part] = 0.0
            self._filter.x[part] = value
            self._filter.P[part, part] = np.eye(2) * sigma**2
        self._read.add(station)

    def update_pixel(
        self, station: str, pixel: FloatArray, covariance_px2: FloatArray, row_dt_s: float = 0.0
    ) -> Innovation | None:
        """Fuse one camera's target pixel (2,) with covariance (2, 2); None if the target is behind the camera.

        Near and beyond the border the pixel is weighted (`OutOfViewWeighting`); beyond the chi-square gate it
        is refused.
        """
        prediction = self.predict_pixel(station, row_dt_s)
        if prediction is None:
            return None
        H = prediction.jacobian
        spread = self.pixel_covariance(prediction)
        residual = pixel - prediction.pixel
        S = spread + covariance_px2
        nis = _squared_sigmas(residual, S)
        accepted = nis <= self._gate
        if accepted:
            R, moved = covariance_px2, residual
            size = self._stations[station].image_size_px
            if self._config.out_of_view is OutOfViewWeighting.PAPER:
                T = paper_weight(prediction.pixel, size, self._config.paper_border_sigma_px)
                moved = T * residual
            else:
                R = covariance_px2 / max(probability_in_view(prediction.pixel, spread, size), 1e-6)
            self._filter.correct(moved, H, R)
        return Innovation(residual=residual, covariance=S, nis=nis, dof=2, accepted=accepted)

    def pixel_covariance(self, prediction: PixelPrediction) -> FloatArray:
        """Return the (2, 2) covariance of a predicted pixel."""
        return innovation_covariance(self._filter.P, prediction.jacobian, np.zeros((2, 2)))


def _squared_sigmas(residual: FloatArray, S: FloatArray) -> float:
    """Return residualᵀ S⁻¹ residual of two numbers."""
    a, b = float(residual[0]), float(residual[1])
    return (S[1, 1] * a * a - (S[0, 1] + S[1, 0]) * a * b + S[0, 0] * b * b) / (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
