"""State, initialisation and prediction of the filter; the measurement updates are in `groundstation.estimation.ekf`."""

import math
from collections.abc import Mapping

import numpy as np
from scipy.stats import chi2

from groundstation.arrays import FloatArray
from groundstation.estimation.clock_monitor import ClockMonitor
from groundstation.estimation.compiled_filter import BoolArray, innovation_covariance
from groundstation.estimation.config import CalibrationUse, EstimationConfig, OutOfViewWeighting
from groundstation.estimation.field_of_view import probability_in_view
from groundstation.estimation.imm import ImmFilter
from groundstation.estimation.linearisation import PixelLinearisation
from groundstation.estimation.measurement import EncoderModel, PixelModel, PixelPrediction, ReferenceModel
from groundstation.estimation.motion import MotionModel
from groundstation.estimation.parameters import LOG_SPAN, ParameterPrior, pointing_places, time_places
from groundstation.estimation.provisional_track import ProvisionalTrack
from groundstation.estimation.second_view import SecondView
from groundstation.estimation.silhouette import WidthModel
from groundstation.estimation.state import EkfState, EkfStateFields, StateLayout, state_layout
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.geometry.station import StationGeometry
from groundstation.messages import CarriedError, Kinematics

# number of stations from which the consistency of the rays makes the rig errors observable
_RAYS_THAT_CHECK = 3


class FilterCore:
    """Filter over one target, the turning stations and the carried errors.

    Parameters
    ----------
    stations : geometry of every station by name.
    turning : names of the stations that have a PTU; their angles are states.
    config : tuning.
    prior : prior of the carried errors of calibration and clocks; none by default.

    The six target states are only used after `start_target`; before it their covariance is zero. Times are session
    seconds; predictions only go forward, `restore` goes back to a snapshot.
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
        self._psds = np.array([motion.psd for motion in self._motions])
        self._imm = ImmFilter(self.layout.size, (config.steady_s, config.manoeuvre_s)[: len(psds)])
        self._imm.set_states(self.layout.constant, np.zeros(len(prior.names)), prior.covariance)
        self._gate = float(chi2.ppf(config.gate_probability, 2))
        self._reference_gate = float(chi2.ppf(config.gate_probability, 3))
        self._pixels = {name: PixelModel(self.layout, geometry) for name, geometry in stations.items()}
        self._encoders = {name: EncoderModel(self.layout, name) for name in turning}
        self._widths = {name: WidthModel(self.layout, geometry) for name, geometry in stations.items()}
        self._width_gate = float(chi2.ppf(config.gate_probability, 1))
        self._reference = ReferenceModel(self.layout)
        self._linearisation = PixelLinearisation(self.layout, self._pixels)
        self._second_view = SecondView(self.layout, self._pixels)
        self._pointing = {name: pointing_places(self.layout.parameters, name) for name in stations}
        self._all = np.ones(self.layout.size, np.bool_)
        self._moving = self._all.copy()
        self._moving[self.layout.constant] = False
        # clock and shutter errors are not estimated here: encoder noise, which resembles motion, would bias them
        self._learnt_from_reference = self._all.copy()
        for name in stations:
            self._learnt_from_reference[time_places(self.layout.parameters, name)] = False
        self._watch = ClockMonitor.of({name: time_places(self.layout.parameters, name) for name in turning})
        self._learns_clocks = config.calibration is CalibrationUse.ESTIMATE
        self._rig_uncertain = any(name.partition(".")[2] in CALIBRATION_PARAMETERS for name in prior.names)
        self._span_only = np.zeros(self.layout.size, np.bool_)
        self._span = self.layout.parameters.get(LOG_SPAN)
        if self._span is not None:
            self._moving[self._span] = self._span_only[self._span] = True
            own = prior.names.index(LOG_SPAN)
            self._span_variance = float(prior.covariance[own, own])
            # a span without process noise is not inflated
            self._span_ages = bool(prior.walk_psd[own] > 0.0)
        self._read: frozenset[str] = frozenset()
        self._first_s: float | None = None
        self._newest_reference_s = -math.inf
        self._references_refused, self._reference_contradicted = 0, False
        # time of the last accepted pixel of each station; only kept with three or more stations
        self._contributed_s: Mapping[str, float] = {}
        # time of the last fused width of this target
        self._width_s: float | None = None
        self._provisional: ProvisionalTrack | None = None
        self.starts_taken_back = 0

    # ------------------------------------------------------------------------------------------ state
    @property
    def state(self) -> FloatArray:
        """The state vector (n,), in the order of the layout; read-only."""
        return self._imm.x

    @property
    def covariance(self) -> FloatArray:
        """The state covariance (n, n); read-only."""
        return self._imm.P

    @property
    def manoeuvring(self) -> float:
        """Probability of the manoeuvre mode, 0 … 1; 0 with a single mode."""
        return float(self._imm.weights[1]) if len(self._motions) > 1 else 0.0

    @property
    def learns(self) -> bool:
        """Whether the carried errors are estimated at present; otherwise they are consider parameters."""
        match self._config.calibration:
            case CalibrationUse.ESTIMATE:
                return True
            case CalibrationUse.CONSIDER:
                return False
            case CalibrationUse.REFERENCE:
                now = -math.inf if self.time_s is None else self.time_s
                oldest = now - self._config.reference_hold_s
                return self._newest_reference_s >= oldest or self._rays_check_each_other(oldest)

    def _rays_check_each_other(self, since_s: float) -> bool:
        """Return whether enough stations have contributed since ``since_s`` to make the rig errors observable."""
        known = self._contributed_s
        return len(known) >= _RAYS_THAT_CHECK and sum(t_s >= since_s for t_s in known.values()) >= _RAYS_THAT_CHECK

    def _note_contribution(self, station: str) -> None:
        if len(self._stations) >= _RAYS_THAT_CHECK and self.time_s is not None:
            self._contributed_s = {**self._contributed_s, station: self.time_s}

    def carried_errors(self) -> tuple[CarriedError, ...]:
        """Return the current estimates of the errors of calibration and clocks."""
        return tuple(
            CarriedError(
                name=name,
                value=float(self.state[place]),
                sigma=math.sqrt(max(float(self.covariance[place, place]), 0.0)),
                prior_sigma=math.sqrt(float(self._prior.covariance[k, k])),
                estimated=bool(self._ever_estimated()[place]),
            )
            for k, (name, place) in enumerate(self.layout.parameters.items())
            if name != LOG_SPAN
        )

    def snapshot(self) -> EkfState:
        """Return the complete state of the filter."""
        return EkfState(*self._state_fields())

    def _state_fields(self) -> EkfStateFields:
        """Return the fields of `EkfState`, in their order; their arrays are never modified in place."""
        return (
            self.time_s,
            self._first_s,
            self.has_target,
            self._imm.snapshot(),
            self._read,
            self._newest_reference_s,
            self._references_refused,
            self._reference_contradicted,
            self._provisional,
            self.starts_taken_back,
            self._watch,
            self._contributed_s,
            self._width_s,
        )

    def restore(self, saved: EkfState) -> None:
        """Restore a `snapshot`."""
        self.time_s, self._first_s, self.has_target = saved.time_s, saved.first_s, saved.has_target
        self._imm.restore(saved.imm)
        self._read, self._newest_reference_s = saved.read, saved.newest_reference_s
        self._references_refused = saved.references_refused
        self._reference_contradicted = saved.reference_contradicted
        self._provisional, self.starts_taken_back = saved.provisional, saved.starts_taken_back
        self._watch, self._contributed_s = saved.watch, saved.contributed_s
        self._width_s = saved.width_s

    def angles(self, station: str) -> tuple[float, float]:
        """Return (pan, tilt) in rad; zero for a fixed station."""
        where = self.layout.angles.get(station)
        if where is None:
            return 0.0, 0.0
        pan, tilt = self.state[where].tolist()
        return pan, tilt

    def start_target(
        self,
        position_m: FloatArray,
        velocity_m_s: FloatArray,
        covariance: FloatArray,
        age_s: float = 0.0,
        *,
        triangulated: bool = False,
    ) -> None:
        """Start a target: (3,), (3,) in the runway frame and covariance (6, 6), valid ``age_s`` before the filter time.

        A state ``triangulated`` with this rig also contains the errors of the rig, which ``covariance`` does not
        include: they are added together with their correlation to the carried errors.
        """
        mean = np.concatenate([position_m, velocity_m_s])
        now_s = 0.0 if self.time_s is None else self.time_s
        begun = ProvisionalTrack(t_s=now_s - age_s, mean=mean, covariance=covariance, triangulated=triangulated)
        # no restarts with the paper's weighting, to reproduce the paper
        self._provisional = None if self._config.out_of_view is OutOfViewWeighting.PAPER else begun
        self._place_target(begun, age_s)

    def _place_target(self, begun: ProvisionalTrack, age_s: float) -> None:
        target, covariance = self.layout.target, begun.covariance
        F = self._motions[-1].transition(age_s)[target, target]
        Q = self._motions[-1].process_noise(age_s)[target, target]
        start = F @ begun.mean
        self._imm.set_states(target, start, F @ covariance @ F.T + Q)
        for part in self.layout.offsets.values():
            self._imm.set_states(part, np.zeros(2), np.eye(2))
        if self._span is not None:
            # reset to the prior, since another aircraft may have another span
            self._width_s = None
            only = slice(self._span, self._span + 1)
            self._imm.set_states(only, np.zeros(1), np.full((1, 1), self._span_variance))
        self._imm.reset_modes()
        self.has_target = True
        if begun.triangulated and self.layout.parameters:
            self._correlate_with_rig(start, F @ covariance @ F.T + Q)

    def _correlate_with_rig(self, start: FloatArray, covariance: FloatArray) -> None:
        """Correct an initial state (6,), triangulated with the rig file, for the estimated errors of the rig."""
        target, constant = self.layout.target, self.layout.constant
        sensitivity = None
        # the sensitivity depends on the position: the second iteration uses the corrected one
        for _ in range(2):
            sensitivity = self._linearisation.sensitivity(self.state, self._age_s())
            if sensitivity is None:
                return
            self._imm.set_states(target, start + sensitivity @ self.state[constant], covariance)
        if sensitivity is not None:
            self._imm.correlate(target, constant, sensitivity)

    def pointing_sigma_rad(self, station: str) -> float:
        """Return one sigma of the pointing of a camera due to the errors of its mount and boresight, rad.

        The larger of pan and tilt; zero for an exact rig.
        """
        P, variance = self.covariance, 0.0
        for places in self._pointing[station]:
            variance = max(variance, sum(float(P[a, b]) for a in places for b in places))
        return math.sqrt(variance)

    def drop_target(self) -> None:
        """Drop the target; the PTU angles and the estimated errors of the rig stay."""
        self._imm.set_states(self.layout.target, np.zeros(6), np.zeros((6, 6)))
        self.has_target = False
        self._provisional = None
        self._newest_reference_s = -math.inf
        self._contributed_s = {}

    def kinematics_at(self, t_s: float) -> Kinematics:
        """Return position, velocity (runway frame) and (6, 6) covariance at ``t_s``, by the motion model only.

        Process noise of the modes is added in both directions; `RecordedEkf` keeps the history needed to smooth
        backwards instead.
        """
        dt = t_s - (self.time_s if self.time_s is not None else t_s)
        if dt == 0.0:
            return self.kinematics_of(self.state, self.covariance)
        F, Q = self.motion_over(dt, self._imm.weights_after(abs(dt)))
        return self.kinematics_of(F @ self.state, F @ self.covariance @ F.T + Q)

    def motion_over(self, dt_s: float, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return F and Q, (n, n) each, over ``dt_s``; the process noises of the modes are weighted by ``weights`` (r,).

        Mixing the modes does not change mean and covariance of the mixture, so that F and Q describe the prediction
        of both.
        """
        Q = sum(w * motion.process_noise(dt_s) for w, motion in zip(weights, self._motions, strict=True))
        return self._motions[0].transition(dt_s), np.asarray(Q)

    def kinematics_of(self, x: FloatArray, P: FloatArray) -> Kinematics:
        """Return the target part of a state (n,) with covariance (n, n)."""
        target = self.layout.target
        own = P[target, target]
        return Kinematics(
            position_runway_m=x[self.layout.position].copy(),
            velocity_runway_m_s=x[self.layout.velocity].copy(),
            covariance=0.5 * (own + own.T),
        )

    # ------------------------------------------------------------------------------------- prediction
    def predict_to(self, t_s: float) -> None:
        """Predict the state to ``t_s``; an earlier time has no effect."""
        if self.time_s is None:
            self.time_s = self._first_s = t_s
        if t_s > self.time_s:
            self._propagate(self.time_s, t_s)

    def _propagate(self, from_s: float, to_s: float) -> FloatArray:
        """Predict the state from its time to a later one and return the transition F (n, n)."""
        F, noises = self._motions[0].with_noises(self._psds, to_s - from_s)
        if not self.has_target:
            noises[:, self.layout.target, self.layout.target] = 0.0
        self._imm.predict(F, noises, to_s - from_s)
        self.time_s = to_s
        return F

    def predict_pixel(self, station: str, row_dt_s: float = 0.0) -> PixelPrediction | None:
        """Return the predicted pixel of the target in one camera at the filter time; None if behind it."""
        return self._pixels[station].predict(self.state, row_dt_s, self._age_s())

    def probability_in_view(self, station: str) -> float:
        """Return the probability that the target is inside the image of a camera."""
        prediction = self.predict_pixel(station)
        if prediction is None:
            return 0.0
        size = self._stations[station].image_size_px
        return probability_in_view(prediction.pixel, self.pixel_covariance(prediction), size)

    def pixel_covariance(self, prediction: PixelPrediction) -> FloatArray:
        """Return the (2, 2) covariance of a predicted pixel."""
        return innovation_covariance(self.covariance, prediction.jacobian, np.zeros((2, 2)))

    def _ever_estimated(self) -> BoolArray:
        """Return which states (n,) are estimated by any update, given a reference."""
        match self._config.calibration:
            case CalibrationUse.ESTIMATE:
                return self._all
            case CalibrationUse.CONSIDER:
                return self._moving
            case CalibrationUse.REFERENCE:
                return self._learnt_from_reference

    def _estimated(self) -> BoolArray:
        """Return which states (n,) an update estimates at present; the others are considered."""
        if not self.learns:
            return self._moving
        estimated = self._ever_estimated()
        quiet = self._watch.quiet() if self._learns_clocks else []
        if quiet:
            estimated = estimated.copy()
            estimated[quiet] = False
        return estimated

    def _age_s(self) -> float:
        """Return the time since the first prediction, for clock drifts."""
        return 0.0 if self.time_s is None or self._first_s is None else self.time_s - self._first_s
