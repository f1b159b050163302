"""The extended Kalman filter over the aircraft, the PTUs and what is uncertain of rig and clocks.

Every reading is an update of its own at its own time: an encoder reading of a station, a pixel of a camera, a
reference position. Updates are in Joseph form. The paper's Section 4.2; its lost equations are written out in
docs/derivation.md.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from groundstation.arrays import FloatArray
from groundstation.estimation.compiled_filter import innovation_covariance, trial_state
from groundstation.estimation.config import CalibrationUse, EstimationConfig, OutOfViewWeighting
from groundstation.estimation.field_of_view import paper_weight, probability_in_view
from groundstation.estimation.measurement import EncoderModel, PixelModel, PixelPrediction, ReferenceModel
from groundstation.estimation.modes import ModeBank
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.parameters import ParameterPrior, clock_places
from groundstation.estimation.state import StateLayout, state_layout
from groundstation.geometry.angles import wrap_rad
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Innovation, Kinematics

# start of an axis that has been read once: it may turn at up to this rate (1 sigma)
_INITIAL_RATE_SIGMA_RAD_S = math.radians(20.0)
# a pixel is linearised anew until that changes it by less than so many sigmas of its noise, or so many times
_LINEAR_SIGMA = 0.1
# and not looked at twice where its prediction is no more uncertain than so many sigmas of its noise
_SETTLED_SIGMA = 2.0
_MAX_LINEARISATIONS = 5


@dataclass(frozen=True, slots=True, eq=False)
class EkfState:
    """Everything that a filter is at one instant, to go back to."""

    time_s: float | None
    first_s: float | None
    has_target: bool
    bank: list[FloatArray]
    read: frozenset[str]
    newest_reference_s: float


class StationEkf:
    """Filter over one target, the turning stations and the carried errors.

    Parameters
    ----------
    stations : geometry of every station by name.
    turning : names of the stations that have a PTU; their angles are states.
    config : tuning.
    prior : the errors of calibration and clocks that are carried along; none by default.

    The target's six states exist only after `start_target`; before it their covariance is zero and they take
    no part. Times are session seconds; the filter never goes back, but `restore` does.
    """

    def __init__(
        self,
        stations: Mapping[str, StationGeometry],
        turning: tuple[str, ...],
        config: EstimationConfig,
        prior: ParameterPrior | None = None,
    ) -> None:
        prior = ParameterPrior.nothing() if prior is None else prior
        prior.require_stations(tuple(stations))
        self.layout: StateLayout = state_layout(turning, prior.names)
        self.time_s: float | None = None
        self.has_target = False
        self._stations = stations
        self._config = config
        psds = [config.acceleration_psd_m2_s3]
        if config.manoeuvre_psd_m2_s3 != config.acceleration_psd_m2_s3:
            psds.append(config.manoeuvre_psd_m2_s3)
        noise = config.ptu_acceleration_psd_rad2_s3
        self._motions = [MotionModel(self.layout, psd, noise, prior.walk_psd) for psd in psds]
        self._bank = ModeBank(self.layout.size, (config.steady_s, config.manoeuvre_s)[: len(psds)])
        self._bank.place(self.layout.constant, np.zeros(len(prior.names)), prior.covariance)
        self._gate = float(chi2.ppf(config.gate_probability, 2))
        self._reference_gate = float(chi2.ppf(config.gate_probability, 3))
        self._pixels = {name: PixelModel(self.layout, geometry) for name, geometry in stations.items()}
        self._encoders = {name: EncoderModel(self.layout, name) for name in turning}
        self._reference = ReferenceModel(self.layout)
        self._clocks = {name: clock_places(self.layout.parameters, name) for name in stations}
        self._is_offset = {place: name.endswith(".offset") for name, place in self.layout.parameters.items()}
        self._all = np.ones(self.layout.size, np.bool_)
        self._moving = self._all.copy()
        self._moving[self.layout.constant] = False
        self._read: set[str] = set()
        self._first_s: float | None = None
        self._newest_reference_s = -math.inf

    # ------------------------------------------------------------------------------------------ state
    @property
    def state(self) -> FloatArray:
        """The state vector (n,), in the layout's order; not to be written to."""
        return self._bank.x

    @property
    def covariance(self) -> FloatArray:
        """The state's covariance (n, n); not to be written to."""
        return self._bank.P

    @property
    def manoeuvring(self) -> float:
        """How likely it is that the aircraft manoeuvres, 0 … 1; 0 where the filter knows but one way of flying."""
        return float(self._bank.weights[1]) if len(self._motions) > 1 else 0.0

    @property
    def learns(self) -> bool:
        """Whether the carried errors are estimated now, and not only considered."""
        match self._config.calibration:
            case CalibrationUse.ESTIMATE:
                return True
            case CalibrationUse.CONSIDER:
                return False
            case CalibrationUse.REFERENCE:
                now = -math.inf if self.time_s is None else self.time_s
                return now - self._newest_reference_s <= self._config.reference_hold_s

    def snapshot(self) -> EkfState:
        """Return all that the filter is now."""
        return EkfState(
            self.time_s,
            self._first_s,
            self.has_target,
            self._bank.snapshot(),
            frozenset(self._read),
            self._newest_reference_s,
        )

    def restore(self, saved: EkfState) -> None:
        """Be again what the filter was at a `snapshot`."""
        self.time_s, self._first_s, self.has_target = saved.time_s, saved.first_s, saved.has_target
        self._bank.restore(saved.bank)
        self._read, self._newest_reference_s = set(saved.read), saved.newest_reference_s

    def angles(self, station: str) -> tuple[float, float]:
        """Return (pan, tilt) in rad; zero for a fixed station."""
        where = self.layout.angles.get(station)
        if where is None:
            return 0.0, 0.0
        pan, tilt = self.state[where]
        return float(pan), float(tilt)

    def start_target(
        self, position_m: FloatArray, velocity_m_s: FloatArray, covariance: FloatArray, age_s: float = 0.0
    ) -> None:
        """Begin a target: (3,), (3,) in the runway frame and covariance (6, 6), as of ``age_s`` before now."""
        target = self.layout.target
        F = self._motions[-1].transition(age_s)[target, target]
        Q = self._motions[-1].process_noise(age_s)[target, target]
        start = F @ np.concatenate([position_m, velocity_m_s])
        self._bank.place(target, start, F @ covariance @ F.T + Q)
        self._bank.forget_modes()
        self.has_target = True

    def drop_target(self) -> None:
        """Forget the target; the PTUs' angles and what was learnt of the rig stay."""
        self._bank.place(self.layout.target, np.zeros(6), np.zeros((6, 6)))
        self.has_target = False

    def kinematics_at(self, t_s: float) -> Kinematics:
        """Return position, velocity and (6, 6) covariance at a time near the filter's own.

        Going back (a pair's mean stamp lies before its second exposure) adds process noise too: the filter
        does not keep what would be needed to take it away.
        """
        target = self.layout.target
        dt = t_s - (self.time_s if self.time_s is not None else t_s)
        F = self._motions[0].transition(dt)[target, target]
        Q = np.zeros((6, 6))
        for weight, motion in zip(self._bank.weights, self._motions, strict=True):
            Q += weight * motion.process_noise(dt)[target, target]
        x = F @ self.state[target]
        P = F @ self.covariance[target, target] @ F.T + Q
        return Kinematics(position_runway_m=x[:3].copy(), velocity_runway_m_s=x[3:].copy(), covariance=0.5 * (P + P.T))

    # ------------------------------------------------------------------------------------- prediction
    def predict_to(self, t_s: float) -> None:
        """Carry the state forward to ``t_s``; an earlier time leaves it where it is."""
        if self.time_s is None:
            self.time_s = self._first_s = t_s
        dt = t_s - self.time_s
        if dt <= 0.0:
            return
        noises = [motion.process_noise(dt) for motion in self._motions]
        if not self.has_target:
            for Q in noises:
                Q[self.layout.target, self.layout.target] = 0.0
        self._bank.predict(self._motions[0].transition(dt), noises, dt)
        self.time_s = t_s

    def predict_pixel(self, station: str, row_dt_s: float = 0.0) -> PixelPrediction | None:
        """Return the target's predicted pixel in one camera now; None if behind it."""
        return self._pixels[station].predict(self.state, row_dt_s, self._age_s())

    # ---------------------------------------------------------------------------------------- updates
    def update_encoder(
        self, station: str, angles_rad: tuple[float, float], sigma_rad: float, clock_sigma_s: float, ahead_s: float
    ) -> Innovation:
        """Fuse one reading of pan and tilt that was true ``ahead_s`` after the filter's time.

        ``clock_sigma_s`` counts as noise of each reading unless the clock's error is carried as a state. A reading
        beyond the gate is not used; the angles' covariance is widened by what it disagrees, since either the
        reading is wrong or the PTU has jerked, and only the next reading can tell.
        """
        if station not in self._read:
            self.set_angles(station, angles_rad, (0.0, 0.0), sigma_rad)
            return Innovation(residual=np.zeros(2), covariance=np.eye(2) * sigma_rad**2, nis=0.0, dof=0, accepted=True)
        model = self._encoders[station]
        expected = model.predict(self.state, ahead_s)
        H = expected.jacobian
        extra = sigma_rad**2 + self._config.ptu_acceleration_psd_rad2_s3 * abs(ahead_s) ** 3 / 3.0
        R = np.diag([extra, extra])
        if not model.carries_clock:
            R += np.diag((clock_sigma_s * self.state[self.layout.rates[station]]) ** 2)
        residual = np.array([wrap_rad(angles_rad[k] - expected.value[k]) for k in range(2)])
        S = innovation_covariance(self.covariance, H, R)
        nis = _squared_sigmas(residual, S)
        allowed = self._config.encoder_gate_sigma**2
        accepted = all(residual[k] ** 2 <= allowed * S[k, k] for k in range(2))
        if accepted:
            self._bank.correct(residual, H, R, self._estimated(), telling=False)
        else:
            self._bank.doubt(self.layout.angles[station], residual**2)
        return Innovation(residual=residual, covariance=S, nis=nis, dof=2, accepted=accepted)

    def set_angles(
        self, station: str, angles_rad: tuple[float, float], rates_rad_s: tuple[float, float], sigma_rad: float
    ) -> None:
        """Start one PTU's states anew from readings, with no memory of before."""
        self._bank.place(self.layout.angles[station], np.array(angles_rad), np.eye(2) * sigma_rad**2)
        self._bank.place(self.layout.rates[station], np.array(rates_rad_s), np.eye(2) * _INITIAL_RATE_SIGMA_RAD_S**2)
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
                if spread[0, 0] > _SETTLED_SIGMA**2 * R[0, 0] or spread[1, 1] > _SETTLED_SIGMA**2 * R[1, 1]:
                    H, moved = self._relinearised(station, prediction, pixel, R, row_dt_s)
            self._bank.correct(moved, H, R + self._speed_noise(station, H), self._estimated(), telling=True)
        return Innovation(residual=residual, covariance=S, nis=nis, dof=2, accepted=accepted)

    def _speed_noise(self, station: str, H: FloatArray) -> FloatArray:
        """Return what a pixel with Jacobian ``H`` gets (2, 2) because a clock's error acts on an uncertain speed.

        A clock that is off by δ moves the pixel by δ·ṁ; the spread of δ times that of ṁ is the term that a linear
        filter leaves out (second order), and would learn clocks from.
        """
        noise = np.zeros((2, 2))
        if not self._clocks[station]:
            return noise
        P = self.covariance
        angles, rates = self.layout.angles.get(station), self.layout.rates.get(station)
        for clock, places in self._clocks[station].items():
            by_state = np.zeros_like(H)
            if angles is not None and rates is not None:
                by_state[:, rates] = H[:, angles]
            if clock == "camera_clock":
                by_state[:, self.layout.velocity] = H[:, self.layout.position]
            spread = innovation_covariance(P, by_state, np.zeros((2, 2)))
            lateness = [1.0 if self._is_offset[k] else self._age_s() for k in places]
            noise += spread * sum(
                P[i, j] * a * b
                for i, a in zip(places, lateness, strict=True)
                for j, b in zip(places, lateness, strict=True)
            )
        return noise

    def _relinearised(
        self, station: str, prediction: PixelPrediction, pixel: FloatArray, R: FloatArray, row_dt_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return H and the residual of a pixel as seen from where the update leads (iterated EKF).

        A target that is known to 10 m only at 600 m makes the plain update wrong by pixels, which it then takes
        for knowledge of the velocity. Once the track has settled the first look is good enough.
        """
        x, P, estimated = self.state, self.covariance, self._estimated()
        H, residual = prediction.jacobian, pixel - prediction.pixel
        for _ in range(_MAX_LINEARISATIONS):
            there = trial_state(x, P, H, R, residual, estimated)
            seen = self._pixels[station].predict(there, row_dt_s, self._age_s())
            if seen is None:
                break
            again = pixel - seen.pixel + seen.jacobian @ (there - x)
            # what the new look makes of the state as it is, and of all that the state may be
            off = _squared_sigmas(again - residual, R)
            turned = innovation_covariance(P, seen.jacobian - H, np.zeros((2, 2)))
            if off + turned[0, 0] / R[0, 0] + turned[1, 1] / R[1, 1] < _LINEAR_SIGMA**2:
                break
            H, residual = seen.jacobian, again
        return H, residual

    def update_reference(self, position_m: FloatArray, covariance_m2: FloatArray, ahead_s: float = 0.0) -> Innovation:
        """Fuse a reference position of the target (3,) with covariance (3, 3), stamped ``ahead_s`` after now.

        For some time after it (`EstimationConfig.reference_hold_s`) the carried errors are learnt from pixels, too.
        """
        expected = self._reference.predict(self.state, ahead_s, self._age_s())
        residual = position_m - expected.value
        S = innovation_covariance(self.covariance, expected.jacobian, covariance_m2)
        nis = float(residual @ np.linalg.solve(S, residual))
        accepted = nis <= self._reference_gate
        if accepted:
            self._newest_reference_s = self.time_s if self.time_s is not None else -math.inf
            self._bank.correct(residual, expected.jacobian, covariance_m2, self._estimated(), telling=True)
        return Innovation(residual=residual, covariance=S, nis=nis, dof=3, accepted=accepted)

    def pixel_covariance(self, prediction: PixelPrediction) -> FloatArray:
        """Return the (2, 2) covariance of a predicted pixel."""
        return innovation_covariance(self.covariance, prediction.jacobian, np.zeros((2, 2)))

    def _estimated(self) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
        """Return which states (n,) an update may move."""
        return self._all if self.learns else self._moving

    def _age_s(self) -> float:
        """Return how long the filter has been running, for what drifts."""
        return 0.0 if self.time_s is None or self._first_s is None else self.time_s - self._first_s


def _squared_sigmas(residual: FloatArray, S: FloatArray) -> float:
    """Return residualᵀ S⁻¹ residual of two numbers."""
    a, b = float(residual[0]), float(residual[1])
    return float(
        (S[1, 1] * a * a - (S[0, 1] + S[1, 0]) * a * b + S[0, 0] * b * b) / (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
    )
