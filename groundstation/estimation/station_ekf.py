"""The extended Kalman filter of the aircraft, the PTU angles and the errors of rig and clocks.

Measurements are fused one by one at their own times; `groundstation.estimation.updates` has a module for each kind. The
paper's Section 4.2; the equations are derived in docs/derivation.md.
"""

import math
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig, OutOfViewWeighting
from groundstation.estimation.ekf_snapshot import EkfSnapshot
from groundstation.estimation.filter_models import FilterModels
from groundstation.estimation.filter_state import FilterState
from groundstation.estimation.journal import ROUNDING_S, FilterJournal, JournalRecord, TargetDrop, TargetStart
from groundstation.estimation.kalman_kernels import innovation_covariance
from groundstation.estimation.out_of_view_weight import probability_in_view
from groundstation.estimation.parameters import LOG_SPAN, ParameterPrior, pointing_sigma_rad
from groundstation.estimation.provisional_track import ProvisionalTrack
from groundstation.estimation.state_model import INITIAL_RATE_SIGMA_RAD_S
from groundstation.estimation.updates.measurements import (
    MissedDetection,
    ReferencePosition,
    SilhouetteWidth,
    TargetPixel,
)
from groundstation.estimation.updates.pixel_model import PixelPrediction
from groundstation.estimation.updates.reference_update import NosePosition
from groundstation.geometry.station import StationGeometry
from groundstation.messages import CarriedError, Innovation, Kinematics


class StationEkf:
    """Filter over one target, the turning stations and the carried errors.

    Parameters
    ----------
    stations : geometry of every station by name.
    turning : names of the stations that have a PTU; their angles are states.
    config : tuning.
    prior : prior of the carried errors of calibration and clocks; none by default.
    journal : receives measurements and transitions, for late data and smoothing; without it nothing is recorded.

    The six target states are only used after `start_target`; before it their covariance is zero. Times are session
    seconds; predictions only go forward, `restore` goes back to a snapshot.
    """

    def __init__(
        self,
        stations: Mapping[str, StationGeometry],
        turning: tuple[str, ...],
        config: EstimationConfig,
        prior: ParameterPrior | None = None,
        journal: FilterJournal | None = None,
    ) -> None:
        self._stations, self._config = stations, config
        self._prior = ParameterPrior.nothing() if prior is None else prior
        self._models = FilterModels(stations, turning, config, self._prior)
        self.layout = self._models.layout
        self._filter = FilterState(self._models, self._prior, journal)

    @property
    def state(self) -> FloatArray:
        """The state vector (n,), in the order of the layout; read-only."""
        return self._filter.imm.x

    @property
    def covariance(self) -> FloatArray:
        """The state covariance (n, n); read-only."""
        return self._filter.imm.P

    @property
    def time_s(self) -> float | None:
        """The filter time, session seconds; None before the first prediction."""
        return self._filter.time_s

    @property
    def learns(self) -> bool:
        """Whether the carried errors are estimated at present; otherwise they are consider parameters."""
        return self._filter.learns

    @property
    def has_target(self) -> bool:
        """Whether a target was started."""
        return self._filter.book.has_target

    @property
    def starts_taken_back(self) -> int:
        """Number of provisional tracks that were restarted, since their first pixels were outliers."""
        return self._filter.book.restarts

    @property
    def manoeuvring(self) -> float:
        """Probability of the manoeuvre mode, 0 … 1; 0 with a single mode."""
        return float(self._filter.imm.weights[1]) if len(self._models.motion) > 1 else 0.0

    def angles(self, station: str) -> tuple[float, float]:
        """Return (pan, tilt) in rad; zero for a fixed station."""
        return self.layout.pan_tilt(self.state, station)

    def carried_errors(self) -> tuple[CarriedError, ...]:
        """Return the current estimates of the errors of calibration and clocks."""
        return tuple(
            CarriedError(
                name=name,
                value=float(self.state[place]),
                sigma=math.sqrt(max(float(self.covariance[place, place]), 0.0)),
                prior_sigma=math.sqrt(float(self._prior.covariance[k, k])),
                estimated=bool(self._models.consider.ever_estimated[place]),
            )
            for k, (name, place) in enumerate(self.layout.parameters.items())
            if name != LOG_SPAN
        )

    def pointing_sigma_rad(self, station: str) -> float:
        """Return one sigma of the pointing of a camera due to its carried mount and boresight errors, rad."""
        return pointing_sigma_rad(self.covariance, self.layout.parameters, station)

    def predict_to(self, t_s: float) -> None:
        """Predict the state to ``t_s``; an earlier time has no effect."""
        self._filter.predict_to(t_s)

    def predicted_ahead(self, t_s: float) -> AbstractContextManager[None]:
        """Predict the filter to ``t_s`` inside the block, for read-only use; nothing is recorded."""
        return self._filter.predicted_ahead(t_s)

    def snapshot(self) -> EkfSnapshot:
        """Return the complete state of the filter."""
        return self._filter.snapshot()

    def restore(self, saved: EkfSnapshot) -> None:
        """Restore a `snapshot`; journal records made since then are removed."""
        self._filter.restore(saved)

    def close_history(self) -> None:
        """End the history and release all its records."""
        self._filter.close_history()

    def motion_over(self, dt_s: float, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return F and Q, (n, n) each, over ``dt_s``, as `MotionModes.mixed_over` with mode ``weights`` (r,)."""
        return self._models.motion.mixed_over(dt_s, weights)

    def predict_pixel(self, station: str, row_dt_s: float = 0.0) -> PixelPrediction | None:
        """Return the predicted pixel of the target in one camera at the filter time; None if behind it."""
        return self._models.pixels[station].predict(self.state, row_dt_s, self._filter.age_s())

    def pixel_covariance(self, prediction: PixelPrediction) -> FloatArray:
        """Return the (2, 2) covariance of a predicted pixel."""
        return innovation_covariance(self.covariance, prediction.jacobian, np.zeros((2, 2)))

    def probability_in_view(self, station: str) -> float:
        """Return the probability that the target is inside the image of a camera."""
        prediction = self.predict_pixel(station)
        if prediction is None:
            return 0.0
        size = self._stations[station].image_size_px
        return probability_in_view(prediction.pixel, self.pixel_covariance(prediction), size)

    def kinematics_at(self, t_s: float) -> Kinematics:
        """Return position, velocity (runway frame) and (6, 6) covariance at ``t_s``, given all measurements so far.

        Behind the filter time by smoothing along the journal, with the newer measurements and no added noise. Ahead of
        it, and beyond the journal, by the motion model with its process noise.
        """
        smoothed = self.smoothed_at(t_s)
        if smoothed is not None:
            return smoothed
        dt = t_s - (self.time_s if self.time_s is not None else t_s)
        if dt == 0.0:
            return self.kinematics_of(self.state, self.covariance)
        F, Q = self._filter.motion_to(t_s)
        return self.kinematics_of(F @ self.state, F @ self.covariance @ F.T + Q)

    def smoothed_at(self, t_s: float) -> Kinematics | None:
        """Return the smoothed target at a time behind the filter; None ahead of it and beyond the journal."""
        journal, now_s = self._filter.journal, self.time_s
        if journal is None or now_s is None or not self.has_target or t_s >= now_s - ROUNDING_S:
            return None
        found = journal.smoothed_at(t_s, self.state, self.covariance, self.motion_over)
        return None if found is None else self.kinematics_of(*found)

    def kinematics_of(self, x: FloatArray, P: FloatArray) -> Kinematics:
        """Return the target part of a state (n,) with covariance (n, n)."""
        own = P[self.layout.target, self.layout.target]
        return Kinematics(
            position_runway_m=x[self.layout.position].copy(),
            velocity_runway_m_s=x[self.layout.velocity].copy(),
            covariance=0.5 * (own + own.T),
        )

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
        self._filter.add_to_journal(TargetStart(position_m, velocity_m_s, covariance, age_s, triangulated))
        mean, t_s = np.concatenate([position_m, velocity_m_s]), (self.time_s or 0.0) - age_s
        track = ProvisionalTrack(t_s=t_s, mean=mean, covariance=covariance, triangulated=triangulated)
        self._place_target(track, age_s)
        # no restarts with the paper's weighting, to reproduce the paper
        provisional = None if self._config.out_of_view is OutOfViewWeighting.PAPER else track
        self._filter.note(provisional=provisional)

    def _place_target(self, track: ProvisionalTrack, age_s: float) -> None:
        """Set the target to the initial state of a track, ``age_s`` before the filter time."""
        self._filter.end_track()
        self._models.start.start(self._filter.imm, track, age_s, self._filter.age_s())
        self._filter.begin_target()

    def drop_target(self) -> None:
        """Drop the target; the PTU angles and the estimated errors of the rig stay."""
        self._filter.add_to_journal(TargetDrop())
        self._filter.end_track()
        self._filter.imm.set_states(self.layout.target, np.zeros(6), np.zeros((6, 6)))
        references = replace(self._filter.book.references, newest_s=-math.inf)
        self._filter.note(has_target=False, provisional=None, references=references, newest_pixel_s={})

    def update_encoder(
        self, station: str, angles_rad: tuple[float, float], sigma_rad: float, clock_sigma_s: float, ahead_s: float
    ) -> Innovation:
        """Fuse one reading of pan and tilt, valid ``ahead_s`` after the filter time.

        ``clock_sigma_s`` is treated as noise of each reading unless the clock error is a state. A reading beyond the
        gate is not fused; the angle covariance is inflated by the residual.
        """
        if station not in self._filter.book.stations_read:
            self.set_angles(station, angles_rad, (0.0, 0.0), sigma_rad)
            return Innovation(residual=np.zeros(2), covariance=np.eye(2) * sigma_rad**2, nis=0.0, dof=0, accepted=True)
        update = self._models.encoder[station]
        reading = update.reading(angles_rad, sigma_rad, clock_sigma_s, ahead_s)
        if self._models.consider.learns_clocks and station in self._filter.book.clock_monitor.squares:
            # includes this reading, before it is used to estimate the clock errors
            nis = update.nis(self.state, self.covariance, reading)
            self._filter.note(clock_monitor=self._filter.book.clock_monitor.read(station, nis / 2.0))
        innovation, correction = update(self._filter.predicted(), reading)
        self._filter.apply(correction)
        return innovation

    def set_angles(
        self,
        station: str,
        angles_rad: tuple[float, float],
        rates_rad_s: tuple[float, float],
        sigma_rad: float,
        rate_sigma_rad_s: float = INITIAL_RATE_SIGMA_RAD_S,
    ) -> None:
        """Reset the states of one PTU from readings, without correlation to the previous ones."""
        self._filter.set_angles(station, angles_rad, rates_rad_s, sigma_rad, rate_sigma_rad_s)

    def update_pixel(
        self,
        station: str,
        pixel: FloatArray,
        covariance_px2: FloatArray,
        row_dt_s: float = 0.0,
        correlated_share: float = 0.0,
    ) -> Innovation | None:
        """Fuse the target pixel (2,) of one camera (`TargetPixel`); None if the target is behind the camera."""
        return self._fuse_pixel(TargetPixel(station, pixel, covariance_px2, row_dt_s, correlated_share))

    def _fuse_pixel(self, pixel: TargetPixel) -> Innovation | None:
        self._filter.add_to_journal(pixel)
        update = self._models.pixel(self._filter.predicted(), pixel)
        if update is None:
            return None
        if not update.innovation.accepted and self._filter.is_contradicted(pixel, update.innovation.residual):
            update = self._models.pixel(self._filter.predicted(), pixel) or update
        self._filter.apply(update.correction)
        self._filter.count_pixel(pixel.station, accepted=update.innovation.accepted)
        if update.innovation.dof == update.innovation.residual.size:
            self._count_pixel(accepted=update.innovation.accepted)
        return update.innovation

    def _count_pixel(self, *, accepted: bool) -> None:
        """Count a pixel of a track; restart a provisional track if its first pixels were outliers."""
        book = self._filter.book
        if book.provisional is None:
            return
        track = book.provisional.after(accepted=accepted)
        if track.refuted:
            initial = track.restarted()
            self._filter.note(provisional=initial, restarts=book.restarts + 1)
            self._place_target(initial, 0.0 if self.time_s is None else self.time_s - initial.t_s)
        else:
            self._filter.note(provisional=None if track.confirmed else track)

    def update_reference(self, reference: ReferencePosition) -> Innovation:
        """Fuse a reference position, and estimate the carried errors for some time after it."""
        self._filter.add_to_journal(reference)
        history = self._filter.book.references
        rig_is_open = self._models.consider.rig_is_open(self.carried_errors())
        self._filter.apply(self._models.reference.clock_step(self._filter.predicted(), reference, history))
        innovation, correction = self._models.reference(
            self._filter.predicted(), reference, history, rig_is_open=rig_is_open
        )
        now_s = self.time_s if self.time_s is not None else -math.inf
        provisional = None if innovation.accepted else self._filter.book.provisional
        history = history.after(innovation, now_s, may_replace=reference.may_replace)
        self._filter.note(references=history, provisional=provisional)
        self._filter.apply(correction)
        return innovation

    def nose_of(self, reference: ReferencePosition) -> NosePosition:
        """Return where a reference has the nose at the filter's time, without its lag and antenna."""
        return self._models.reference.nose_of(self._filter.predicted(), reference)

    def update_width(self, station: str, width_px: float, span_m: float, *, alone: bool) -> Innovation | None:
        """Fuse a silhouette width (`SilhouetteWidth`); None where it gives no information."""
        return self._fuse_width(SilhouetteWidth(station=station, width_px=width_px, span_m=span_m, alone=alone))

    def _fuse_width(self, width: SilhouetteWidth) -> Innovation | None:
        self._filter.add_to_journal(width)
        expected = self._models.width.predict(self._filter.predicted(), width)
        if expected is None:
            return None
        newest_s = self._filter.book.newest_width_s
        if self.time_s is not None and newest_s is not None:
            self._filter.apply(self._models.width.span_inflation(width.width_px, self.time_s - newest_s))
        self._filter.note(newest_width_s=self.time_s)
        innovation, correction = self._models.width(self._filter.predicted(), width, expected)
        self._filter.apply(correction)
        return innovation

    def update_miss(self, station: str, detection_probability: float) -> None:
        """Update with a missed detection of one camera (`MissedDetection`)."""
        self._fuse_miss(MissedDetection(station=station, detection_probability=detection_probability))

    def _fuse_miss(self, miss: MissedDetection) -> None:
        self._filter.add_to_journal(miss)
        self._filter.apply(self._models.miss(self._filter.predicted(), miss))

    def repeat(self, record: JournalRecord) -> None:
        """Apply a journal record again, with the gates evaluated at the present state."""
        match record:
            case TargetPixel():
                self._fuse_pixel(record)
            case SilhouetteWidth():
                self._fuse_width(record)
            case MissedDetection():
                self._fuse_miss(record)
            case ReferencePosition():
                self.update_reference(record)
            case TargetStart(position_m=position, velocity_m_s=velocity, covariance=covariance, age_s=age_s):
                self.start_target(position, velocity, covariance, age_s, triangulated=record.triangulated)
            case TargetDrop():
                self.drop_target()
