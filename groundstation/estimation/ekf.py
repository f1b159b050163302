"""The extended Kalman filter over the aircraft, the PTUs and what is uncertain of rig and clocks.

Every reading is an update of its own at its own time: an encoder reading of a station, a pixel of a camera, a
reference position. Updates are in Joseph form. The paper's Section 4.2; its lost equations are written out in
docs/derivation.md.
"""

import math
from collections.abc import Mapping

import numpy as np
from scipy.stats import chi2

from groundstation.arrays import FloatArray
from groundstation.estimation.compiled_filter import innovation_covariance, squared_sigmas
from groundstation.estimation.config import CalibrationUse, EstimationConfig, OutOfViewWeighting
from groundstation.estimation.field_of_view import paper_weight, probability_in_view
from groundstation.estimation.linearisation import Linearised, PixelLinearisation
from groundstation.estimation.measurement import EncoderModel, PixelModel, PixelPrediction, ReferenceModel
from groundstation.estimation.modes import ModeBank
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.state import EkfState, StateLayout, state_layout
from groundstation.geometry.angles import wrap_rad
from groundstation.geometry.station import StationGeometry
from groundstation.messages import CarriedError, Innovation, Kinematics

# start of an axis that has been read once: it may turn at up to this rate (1 sigma)
_INITIAL_RATE_SIGMA_RAD_S = math.radians(20.0)
# what calibration may have done to a velocity that was found without a reference
_ADOPTED_SPEED_SHARE, _ADOPTED_SPEED_M_S = 0.1, 0.5


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
        self._prior = prior
        lasting = tuple(stations) if config.detection_lasting_share > 0.0 else ()
        self.layout: StateLayout = state_layout(turning, prior.names, lasting)
        self.time_s: float | None = None
        self.has_target = False
        self._stations = stations
        self._config = config
        psds = [config.acceleration_psd_m2_s3]
        if config.manoeuvre_psd_m2_s3 != config.acceleration_psd_m2_s3:
            psds.append(config.manoeuvre_psd_m2_s3)
        noise = config.ptu_acceleration_psd_rad2_s3
        self._motions = [
            MotionModel(self.layout, psd, noise, prior.walk_psd, config.detection_lasting_s) for psd in psds
        ]
        self._bank = ModeBank(self.layout.size, (config.steady_s, config.manoeuvre_s)[: len(psds)])
        self._bank.place(self.layout.constant, np.zeros(len(prior.names)), prior.covariance)
        self._gate = float(chi2.ppf(config.gate_probability, 2))
        self._reference_gate = float(chi2.ppf(config.gate_probability, 3))
        self._pixels = {name: PixelModel(self.layout, geometry) for name, geometry in stations.items()}
        self._encoders = {name: EncoderModel(self.layout, name) for name in turning}
        self._reference = ReferenceModel(self.layout)
        self._bends = PixelLinearisation(self.layout, self._pixels)
        self._all = np.ones(self.layout.size, np.bool_)
        self._moving = self._all.copy()
        self._moving[self.layout.constant] = False
        self._rig_uncertain = any(not name.startswith("dgps_") for name in prior.names)
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

    def carried_errors(self) -> tuple[CarriedError, ...]:
        """Return what is known now of the errors of calibration and clocks."""
        return tuple(
            CarriedError(
                name=name,
                value=float(self.state[place]),
                sigma=math.sqrt(max(float(self.covariance[place, place]), 0.0)),
                prior_sigma=math.sqrt(float(self._prior.covariance[k, k])),
            )
            for k, (name, place) in enumerate(self.layout.parameters.items())
        )

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
        self,
        position_m: FloatArray,
        velocity_m_s: FloatArray,
        covariance: FloatArray,
        age_s: float = 0.0,
        *,
        triangulated: bool = False,
    ) -> None:
        """Begin a target: (3,), (3,) in the runway frame and covariance (6, 6), as of ``age_s`` before now.

        What was ``triangulated`` with this rig has the rig's errors in it, beside the noise that ``covariance`` tells:
        they are added, and the filter knows that they are the same.
        """
        target = self.layout.target
        F = self._motions[-1].transition(age_s)[target, target]
        Q = self._motions[-1].process_noise(age_s)[target, target]
        start = F @ np.concatenate([position_m, velocity_m_s])
        self._bank.place(target, start, F @ covariance @ F.T + Q)
        for part in self.layout.offsets.values():
            self._bank.place(part, np.zeros(2), np.eye(2))
        self._bank.forget_modes()
        self.has_target = True
        if triangulated and self.layout.parameters:
            sensitivity = self._bends.sensitivity(self.state, self._age_s())
            if sensitivity is not None:
                self._bank.share(target, self.layout.constant, sensitivity)

    def drop_target(self) -> None:
        """Forget the target; the PTUs' angles and what was learnt of the rig stay."""
        self._bank.place(self.layout.target, np.zeros(6), np.zeros((6, 6)))
        self.has_target = False
        self._newest_reference_s = -math.inf

    def kinematics_at(self, t_s: float) -> Kinematics:
        """Return position, velocity (runway frame) and (6, 6) covariance at ``t_s``, by the motion model alone.

        Ahead, the modes' process noise is added. Going back adds it, too: this filter does not keep what would be
        needed to take it away (`RecordedEkf` does).
        """
        dt = t_s - (self.time_s if self.time_s is not None else t_s)
        F, Q = self.motion_over(dt, self._bank.weights_after(abs(dt)))
        return self.kinematics_of(F @ self.state, F @ self.covariance @ F.T + Q)

    def motion_over(self, dt_s: float, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return F and Q, (n, n) each, over ``dt_s``; the modes' noises are weighed by ``weights`` (r,).

        Mixing the modes leaves mean and covariance of their mixture as they are, so this is what a prediction does
        to the two.
        """
        Q = sum(w * motion.process_noise(dt_s) for w, motion in zip(weights, self._motions, strict=True))
        return self._motions[0].transition(dt_s), np.asarray(Q)

    def kinematics_of(self, x: FloatArray, P: FloatArray) -> Kinematics:
        """Return the target's part of a state (n,) with its covariance (n, n)."""
        target = self.layout.target
        own = P[target, target]
        return Kinematics(
            position_runway_m=x[self.layout.position].copy(),
            velocity_runway_m_s=x[self.layout.velocity].copy(),
            covariance=0.5 * (own + own.T),
        )

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
        nis = squared_sigmas(residual, S)
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
        self,
        station: str,
        pixel: FloatArray,
        covariance_px2: FloatArray,
        row_dt_s: float = 0.0,
        lasting_share: float = 0.0,
    ) -> Innovation | None:
        """Fuse one camera's target pixel (2,) with covariance (2, 2); None if the target is behind the camera.

        ``lasting_share`` of that covariance is an error that this station's next pixels will share. Near and beyond
        the border the pixel is weighted (`OutOfViewWeighting`); beyond the chi-square gate it is refused.
        """
        prediction = self.predict_pixel(station, row_dt_s)
        if prediction is None:
            return None
        H, R = prediction.jacobian, covariance_px2
        in_view = self.pixel_covariance(prediction)
        measured = pixel
        offset = self.layout.offsets.get(station)
        if offset is not None and lasting_share > 0.0:
            H = H.copy()
            H[:, offset] = np.linalg.cholesky(lasting_share * covariance_px2)
            measured = pixel - H[:, offset] @ self.state[offset]
            R = (1.0 - lasting_share) * covariance_px2
        residual = measured - prediction.pixel
        S = innovation_covariance(self.covariance, H, R)
        nis = squared_sigmas(residual, S)
        accepted = nis <= self._gate
        if accepted:
            moved = residual
            size = self._stations[station].image_size_px
            if self._config.out_of_view is OutOfViewWeighting.PAPER:
                moved = paper_weight(prediction.pixel, size, self._config.paper_border_sigma_px) * residual
            else:
                R = R / max(probability_in_view(prediction.pixel, in_view, size), 1e-6)
                state = (self.state, self.covariance, self._estimated())
                first = Linearised(jacobian=H, residual=residual)
                seen = self._bends.iterated(station, measured, first, state, R, (row_dt_s, self._age_s()))
                H, moved = seen.jacobian, seen.residual
            R = R + self._bends.speed_noise(station, H, self.covariance, self._age_s())
            self._bank.correct(moved, H, R, self._estimated(), telling=True)
        return Innovation(residual=residual, covariance=S, nis=nis, dof=2, accepted=accepted)

    def update_reference(self, position_m: FloatArray, covariance_m2: FloatArray, ahead_s: float = 0.0) -> Innovation:
        """Fuse a reference position of the target (3,) with covariance (3, 3), stamped ``ahead_s`` after now.

        For some time after it (`EstimationConfig.reference_hold_s`) the carried errors are learnt from pixels, too. The
        first of a target replaces its position: what pixels alone gave may be tens of metres off by the errors that are
        to be learnt now, too far to be linearised about.
        """
        first = self._newest_reference_s == -math.inf
        if first and self._rig_uncertain and self._config.calibration is CalibrationUse.REFERENCE:
            return self._adopt(position_m, covariance_m2, ahead_s)
        expected = self._reference.predict(self.state, ahead_s, self._age_s())
        residual = position_m - expected.value
        # between now and when it was true the aircraft has flown as it liked
        away = self._reference.lateness_s(self.state, self.covariance, ahead_s, self._age_s())
        here = self.layout.position
        covariance_m2 = covariance_m2 + self._motions[0].process_noise(away)[here, here]
        S = innovation_covariance(self.covariance, expected.jacobian, covariance_m2)
        nis = float(residual @ np.linalg.solve(S, residual))
        accepted = nis <= self._reference_gate
        if accepted:
            self._newest_reference_s = self.time_s if self.time_s is not None else -math.inf
            self._bank.correct(residual, expected.jacobian, covariance_m2, self._estimated(), telling=True)
        return Innovation(residual=residual, covariance=S, nis=nis, dof=3, accepted=accepted)

    def _adopt(self, position_m: FloatArray, covariance_m2: FloatArray, ahead_s: float) -> Innovation:
        """Put the target where a reference says, with the doubt and the correlations of its clock and antenna."""
        expected = self._reference.predict(self.state, ahead_s, self._age_s())
        residual = position_m - expected.value
        velocity = self.state[self.layout.velocity].copy()
        spread = self.covariance[self.layout.velocity, self.layout.velocity].copy()
        spread += np.eye(3) * (_ADOPTED_SPEED_SHARE * float(np.linalg.norm(velocity)) + _ADOPTED_SPEED_M_S) ** 2
        self._bank.place(self.layout.position, self.state[self.layout.position] + residual, covariance_m2)
        self._bank.place(self.layout.velocity, velocity, spread)
        self._bank.share(self.layout.position, self.layout.constant, -expected.jacobian[:, self.layout.constant])
        self._newest_reference_s = self.time_s if self.time_s is not None else -math.inf
        return Innovation(residual=residual, covariance=covariance_m2, nis=0.0, dof=0, accepted=True)

    def pixel_covariance(self, prediction: PixelPrediction) -> FloatArray:
        """Return the (2, 2) covariance of a predicted pixel."""
        return innovation_covariance(self.covariance, prediction.jacobian, np.zeros((2, 2)))

    def _estimated(self) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
        """Return which states (n,) an update may move."""
        return self._all if self.learns else self._moving

    def _age_s(self) -> float:
        """Return how long the filter has been running, for what drifts."""
        return 0.0 if self.time_s is None or self._first_s is None else self.time_s - self._first_s
