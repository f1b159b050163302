"""Track management: start, status and drop of the single target, epoch by epoch.

The pipeline passes candidates and fixes; the manager starts the target, updates its status and drops it. Log events
and other changes are collected in `TrackManager.changes`.
"""

import math
from collections.abc import Mapping

import numpy as np

from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.earlier_pixels import EarlierPixels
from groundstation.estimation.guided_search import GuidedPlace, GuidedSearch
from groundstation.estimation.initialise import TrackInitiator
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.tentative_track import InitiatedTarget
from groundstation.estimation.trajectory_curve import Knot, TrajectoryPredictor
from groundstation.geometry.chi_square import chi_square_limit
from groundstation.messages import (
    Epoch,
    Frame,
    InitialState,
    Kinematics,
    OutcomeKind,
    PixelMeasurement,
    TrackEvent,
    TrackState,
    TrackStatus,
)
from groundstation.tracking.alternative_track import AlternativeTrack
from groundstation.tracking.camera_tracker import CameraTracker, SpanModel
from groundstation.tracking.config import Config
from groundstation.tracking.detected_point import DetectedPoint
from groundstation.tracking.epoch_buffer import EpochViews
from groundstation.tracking.search_schedule import SearchSchedule
from groundstation.tracking.track_changes import TrackChanges
from groundstation.tracking.track_state_machine import TrackStateMachine

# other traffic is behind the aircraft that lands: of two, one whose distance is less than this share of the other's
_FAR_NEARER = 0.5
# a target that is found again is farther from its prediction with this probability
_FARTHER_CHANCE = 1e-3
# pixels of two cameras so close in time confirm a target, though pairs lose frames
_TOGETHER_S = 0.1
# no epoch is processed so late: a stamp farther ahead of it is wrong, and would keep a track that has no pictures
_MOST_DELAY_S = 2.0


class TrackManager:
    """Holds the status of the target, the tentative tracks of the initiator and the last trajectory knots.

    ``initial`` is a given initial state; there is no search before its time.
    """

    def __init__(
        self,
        ekf: StationEkf,
        cameras: Mapping[str, CameraTracker],
        config: Config,
        *,
        span: SpanModel,
        initial: InitialState | None,
    ) -> None:
        self.predictor = TrajectoryPredictor(config.estimation.predictor)
        self.state_machine = TrackStateMachine(config.estimation)
        self._ekf = ekf
        self._cameras = cameras
        self._window_s = config.estimation.fix_window_s
        self._coast_after_s = config.estimation.coast_after_s
        self._newest_epoch_s = -math.inf
        # when a pixel was accepted of each camera, and when one of a cut silhouette, too
        self._accepted_s: dict[str, float] = {}
        self._seen_s: dict[str, float] = {}
        geometries = {n: c.geometry for n, c in cameras.items()}
        self._eyes_m = [each.camera_pose(0.0, 0.0).position_runway_m for each in geometries.values()]
        self._initiator = TrackInitiator(geometries, config.initiation, span.span_m)
        self._guided = GuidedSearch(geometries, config.initiation, span.span_m)
        self._earlier = EarlierPixels(geometries, config.initiation)
        self.detected_point = DetectedPoint(config, cameras, span, self._eyes_m)
        self._alternative = AlternativeTrack(geometries, config.initiation, span.span_m)
        self._initial = initial
        self._schedule = SearchSchedule()
        self._labels: list[CameraCandidate] = []
        self.changes = TrackChanges()

    def log(self, t_s: float, level: str, text: str) -> None:
        """Add a line to the log events."""
        self.changes.events.append(TrackEvent(t_s=t_s, level=level, text=text))

    def needs_search(self, t_s: float) -> bool:
        """Return whether whole frames are searched: there is no target, or it could yield to another."""
        if self._initial is not None:
            return False
        return not self._ekf.has_target or self.state_machine.needs_search(t_s)

    def searches(self, record: Frame | PixelMeasurement) -> bool:
        """Return whether a station's frame is searched as a whole, or its labelled pixel taken, which costs nothing."""
        if not self.needs_search(record.t_s):
            return False
        if isinstance(record, PixelMeasurement):
            return True
        has_target = self._ekf.has_target
        return self._schedule.is_due(record.station, record.t_s, epoch=record.epoch, has_target=has_target)

    def guided_places(self, record: Frame, pan_rad: float, tilt_rad: float) -> list[GuidedPlace]:
        """Return where a station's frame may show what other cameras have found lately."""
        return self._guided.places(record.station, record.t_s, pan_rad, tilt_rad)

    def add_search(self, station: str, t_s: float, candidates: list[CameraCandidate]) -> None:
        """Add the candidates of a frame for the next epoch."""
        self._schedule.add(station, t_s, candidates)
        self._guided.add(station, candidates)
        self._earlier.add(station, t_s, candidates)

    def add_label(self, label: CameraCandidate) -> None:
        """Add a labelled pixel for the next epoch."""
        self._labels.append(label)

    def start_if_due(self, t_s: float) -> None:
        """Start the target from the given initial state once its time is reached; the filter is at ``t_s``."""
        start = self._initial
        if start is None or t_s < start.t_s:
            return
        self._initial = None
        sigmas = np.concatenate([start.sigma_position_m, start.sigma_velocity_m_s])
        given = Kinematics(
            position_runway_m=start.position_runway_m,
            velocity_runway_m_s=start.velocity_runway_m_s,
            covariance=np.diag(sigmas**2),
        )
        self._start_track(start.t_s, given, "given")

    def process_epoch(self, epoch: Epoch, views: EpochViews, *, newest_s: float) -> Kinematics | None:
        """Update the track with one epoch and return its estimate at the epoch's stamp, if it is reported.

        ``views`` are the epoch's pixels. ``newest_s`` is the newest stamp of any device, which gives the delay of the
        epoch.
        """
        t_s = epoch.t_s
        fixed = len(views.accepted) >= 2
        self._accepted_s.update(dict.fromkeys(views.accepted, t_s))
        self._seen_s.update(dict.fromkeys(views.seen, t_s))
        proof = bool(views.views) and self._is_proved(t_s)
        self._newest_epoch_s = max(self._newest_epoch_s, t_s, min(newest_s, t_s + _MOST_DELAY_S))
        if self._ekf.has_target:
            self._update_status(t_s, fixed, proof)
        if self._ekf.has_target:
            self._correct(t_s, views)
        if self.needs_search(t_s):
            self._initiate(epoch)
        else:
            # the search has ended: its candidates are not used for a later one
            self._labels.clear()
            self._schedule.clear()
            self._initiator.reset()
        if not self.is_confirmed:
            return None
        kinematics = self._ekf.kinematics_at(t_s)
        self.predictor.add(Knot(t_s=t_s, position_m=kinematics.position_runway_m))
        return self.reported(kinematics)

    @property
    def track_id(self) -> int | None:
        """Number of the track, counted from 1, which may not be confirmed yet; None without one."""
        return self.changes.track_id if self._ekf.has_target else None

    @property
    def is_confirmed(self) -> bool:
        """Whether there is a target with a reported estimate."""
        return self._ekf.has_target and self.state_machine.status is not TrackStatus.ACQUIRING

    def reported(self, kinematics: Kinematics) -> Kinematics:
        """Return an estimate of the filter as one of the target point, if a detector has found it."""
        return self.detected_point.as_target_point(kinematics)

    def is_quiet(self, t_s: float) -> bool:
        """Return whether the last epoch is so old that the status depends on time only."""
        return t_s - max(self._newest_epoch_s, self.state_machine.started_s) > self._coast_after_s

    def must_drop(self, t_s: float) -> bool:
        """Update the track status at a time without an epoch; return whether the target is to be dropped.

        The conditions are evaluated on the prediction to ``t_s``; the filter itself is not predicted.
        """
        if not self._ekf.has_target:
            if self.state_machine.status is TrackStatus.ACQUIRING:
                self._set_status(t_s, TrackStatus.SEARCHING)
            return False
        with self._ekf.predicted_ahead(t_s):
            if self.state_machine.is_lost(t_s, self._ekf, self._cameras):
                return True
        recognised = self.state_machine.recognition.is_recognised
        if self.state_machine.confirmation.is_overdue(t_s, recognised=recognised):
            self.log(t_s, "warning", "candidate dropped: no pictures to confirm it")
            return True
        self._set_status(t_s, self.state_machine.update(False, self._ekf))
        return False

    def state_at(self, t_s: float) -> TrackState:
        """Return the track status at ``t_s``, with the predicted estimate if it is reported."""
        now_s = t_s if self._ekf.time_s is None else max(t_s, self._ekf.time_s)
        kinematics = self.reported(self._ekf.kinematics_at(now_s)) if self.is_confirmed else None
        return TrackState(t_s=t_s, status=self.state_machine.status, kinematics=kinematics)

    def _is_proved(self, t_s: float) -> bool:
        """Return whether pixels of two or more cameras, close in time, are evidence of the target.

        Of an aircraft that stands and is recognised cut silhouettes are: it may stand across the border until it takes
        off. Of all else they are not, as where it is, is what the filter expects.
        """
        machine = self.state_machine
        stands = machine.recognition.is_recognised and machine.confirmation.is_standing
        pixels = self._seen_s if stands else self._accepted_s
        return sum(t_s - at_s <= _TOGETHER_S for at_s in pixels.values()) >= 2

    def _update_status(self, t_s: float, fixed: bool, proof: bool) -> None:
        """Update the status of the target, and drop it if it is lost or a false track."""
        machine = self.state_machine
        if proof:
            machine.add_fix(t_s)
        recognised = machine.recognition.is_recognised
        if machine.is_lost(t_s, self._ekf, self._cameras):
            self.drop(t_s)
        elif machine.confirmation.is_false_track(t_s, self._ekf, recognised=recognised):
            self.log(t_s, "warning", "what was found does not move as an aircraft does: dropped")
            self._initiator.discard(self._ekf.kinematics_at(t_s))
            self.drop(t_s)
        else:
            crossed = machine.confirmation.has_crossed
            self._set_status(t_s, machine.update(fixed, self._ekf))
            if machine.confirmation.has_crossed and not crossed:
                self.log(t_s, "info", "what was found crosses on the ground, and is not recognised: not reported")

    def _correct(self, t_s: float, views: EpochViews) -> None:
        """Restart the target where cameras agree on another place than the filter's, look after look."""
        machine = self.state_machine
        if machine.status not in (TrackStatus.TRACKING, TrackStatus.COASTING):
            # a target that is not confirmed yet is dropped, not corrected
            self._alternative.reset()
            return
        found = self._alternative.step(t_s, views, known_lately=machine.seen_by_two(t_s))
        if found is not None:
            self._start_track(t_s, found, "corrected")

    def _initiate(self, epoch: Epoch) -> None:
        """Pass the candidates of this epoch to the initiator; start the target when one is confirmed."""
        seen = self._schedule.combined(epoch.t_s)
        # labelled pixels arrive one by one at their own times: the newest of each station are combined
        labelled = {s.station: s for s in self._labels if epoch.t_s - s.t_s <= self._window_s}
        self._labels = list(labelled.values()) if len(labelled) < 2 else []
        if seen is None and len(labelled) < 2:
            # what one camera alone shows is no evidence against what others have shown
            return
        seen = seen or []
        machine = self.state_machine
        followed = self._ekf.has_target and machine.seen_by_two(epoch.t_s) and not machine.is_doubtful(epoch.t_s)
        known = self._ekf.kinematics_at(epoch.t_s) if followed else None
        confirmed = self._initiator.step(epoch.t_s, [*seen, *labelled.values()], known)
        if found := next((each for each in confirmed if self._is_better(epoch.t_s, each)), None):
            labels = bool(labelled) and not seen
            self._start_track(epoch.t_s, found.kinematics, "found in labels" if labels else "acquired", found)
        elif self._ekf.has_target:
            return
        elif self._initiator.promising:
            self._set_status(epoch.t_s, TrackStatus.ACQUIRING)
        elif machine.status is TrackStatus.ACQUIRING:
            self._set_status(epoch.t_s, TrackStatus.SEARCHING)

    def _is_better(self, t_s: float, found: InitiatedTarget) -> bool:
        """Return whether a found target is followed from now on, instead of the one that there may be."""
        machine = self.state_machine
        if not self._ekf.has_target:
            return True
        if found.moving and machine.is_doubtful(t_s) and not machine.is_likelier_than(t_s, found.odds):
            return True
        if found.recognised and machine.is_missed(t_s) and self._fits_prediction(t_s, found):
            return True
        moving_s = found.age_s if found.moving else None
        own_m, other_m = self._range_m(self._ekf.kinematics_at(t_s)), self._range_m(found.kinematics)
        return machine.yields_to(
            recognised=found.recognised,
            moving_s=moving_s,
            odds=found.odds,
            far_nearer=other_m < _FAR_NEARER * own_m,
        )

    def _fits_prediction(self, t_s: float, found: InitiatedTarget) -> bool:
        """Return whether a found target is as likely as the followed one, and has a place and velocity it may have."""
        own = self._ekf.kinematics_at(t_s)
        away = np.concatenate([found.kinematics.position_runway_m, found.kinematics.velocity_runway_m_s])
        away -= np.concatenate([own.position_runway_m, own.velocity_runway_m_s])
        square = float(away @ np.linalg.solve(own.covariance + found.kinematics.covariance, away))
        near = square <= chi_square_limit(_FARTHER_CHANCE, len(away))
        return near and not self.state_machine.recognition.is_likelier_than(found.odds)

    def _range_m(self, target: Kinematics) -> float:
        """Return the distance of a target from the nearest station, m."""
        return min(float(np.linalg.norm(target.position_runway_m - eye)) for eye in self._eyes_m)

    def _start_track(self, t_s: float, start: Kinematics, how: str, found: InitiatedTarget | None = None) -> None:
        """Start the filter from a state at ``t_s``; only targets ``found`` among candidates need confirmation."""
        if self._ekf.has_target:
            # replaces the current target, whose appearance and size are discarded
            self._reset_cameras()
        age_s = 0.0 if self._ekf.time_s is None else self._ekf.time_s - t_s
        position = start.position_runway_m
        self._ekf.start_target(
            position, start.velocity_runway_m_s, start.covariance, age_s, triangulated=how != "given"
        )
        self._initiator.reset()
        self._guided.reset()
        self._alternative.reset()
        self._labels.clear()
        self._schedule.clear()
        self._accepted_s.clear()
        self._seen_s.clear()
        self.state_machine.start(
            t_s + max(age_s, 0.0),
            position if how == "acquired" else None,
            known=how == "corrected",
            standing=found is not None and not found.moving,
            odds=None if found is None else found.odds,
        )
        x, y, z = position
        where = f"({x:.1f}, {y:.1f}, {z:.1f}) m"
        if how == "corrected":
            self.log(t_s, "warning", f"cameras agree on {where} and not with the filter: target restarted there")
        else:
            self.log(t_s, "info", f"target {how} at {where}{', recognised' if found and not found.moving else ''}")
        self.changes.start(() if found is None else self._earlier.of(t_s, start, found.pixels))
        if found is None:
            self.changes.decide(OutcomeKind.CONFIRMED)
        self._set_status(t_s, TrackStatus.COASTING if how == "corrected" else TrackStatus.ACQUIRING)

    def drop(self, t_s: float) -> None:
        """Drop the target as lost."""
        self.changes.decide(OutcomeKind.DROPPED)
        self._ekf.drop_target()
        self._guided.reset()
        self._alternative.reset()
        self._reset_cameras()
        self._set_status(t_s, TrackStatus.LOST)

    def _reset_cameras(self) -> None:
        self.predictor.reset()
        for camera in self._cameras.values():
            camera.reset()

    def _set_status(self, t_s: float, status: TrackStatus) -> None:
        if status in (TrackStatus.TRACKING, TrackStatus.COASTING):
            self.changes.decide(OutcomeKind.CONFIRMED)
        event = self.state_machine.set_status(t_s, status)
        if event is not None:
            self.changes.events.append(event)
