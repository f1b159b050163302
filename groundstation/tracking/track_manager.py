"""Beginning, keeping and dropping the one target of the filter, epoch by epoch.

The pipeline hands in what was sighted and what was fixed; this decides when a target begins, whether it lives
on, and what the status is. Whatever is worth a line in the log is kept until `take_events`.
"""

import math
from collections.abc import Mapping

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.ekf import StationEkf
from groundstation.estimation.initialise import CameraCandidate, TrackInitiator
from groundstation.estimation.trajectory_curve import Knot, TrajectoryPredictor
from groundstation.messages import Epoch, InitialState, Kinematics, TrackEvent, TrackState, TrackStatus
from groundstation.tracking.camera_tracker import CameraTracker
from groundstation.tracking.config import Config
from groundstation.tracking.track_state_machine import TrackStateMachine

# candidates of whole frames belong to the epoch that is answered, not to one long past
_SIGHTING_S = 0.5


class TrackManager:
    """Holds the status of the target, its tentative forerunners and its last knots.

    ``initial`` is a start that someone gives: until its time has come nothing is searched for.
    """

    def __init__(
        self,
        ekf: StationEkf,
        cameras: Mapping[str, CameraTracker],
        config: Config,
        *,
        span_m: float | None,
        initial: InitialState | None,
    ) -> None:
        self.predictor = TrajectoryPredictor(config.estimation.predictor)
        self.life = TrackStateMachine(config.estimation)
        self._ekf = ekf
        self._cameras = cameras
        self._window_s = config.estimation.fix_window_s
        self._coast_after_s = config.estimation.coast_after_s
        self._answered_s = -math.inf
        self._initiator = TrackInitiator({n: c.geometry for n, c in cameras.items()}, config.initiation, span_m)
        self._initial = initial
        self._sightings: list[CameraCandidate] = []
        self._events: list[TrackEvent] = []

    def take_events(self) -> list[TrackEvent]:
        """Return what has happened since the last call."""
        events, self._events = self._events, []
        return events

    def say(self, t_s: float, level: str, text: str) -> None:
        """Keep a line for the log."""
        self._events.append(TrackEvent(t_s=t_s, level=level, text=text))

    def searches(self, t_s: float) -> bool:
        """Return whether whole frames are to be searched: nothing is held, or no fix has come for a while."""
        if self._initial is not None:
            return False
        return not self._ekf.has_target or self.life.needs_search(t_s)

    def sighted(self, sightings: list[CameraCandidate]) -> None:
        """Take candidates for the epoch to come."""
        self._sightings += sightings

    def start_if_due(self, t_s: float) -> None:
        """Begin the target that was given once its time has come; the filter stands at ``t_s``."""
        start = self._initial
        if start is None or t_s < start.t_s:
            return
        self._initial = None
        sigmas = np.concatenate([start.sigma_position_m, start.sigma_velocity_m_s])
        self._begin(start.t_s, start.position_runway_m, start.velocity_runway_m_s, np.diag(sigmas**2), "given")

    def answer(self, epoch: Epoch, *, fixed: bool, proof: bool, newest_s: float) -> Kinematics | None:
        """Bring the target through one epoch and return its estimate at the epoch's stamp, if there is one.

        ``fixed``: two or more cameras' pixels were accepted; ``proof``: and at least one of them is new. ``newest_s``
        is the newest stamp that any device has sent: how late it is that the epoch is answered.
        """
        t_s = epoch.t_s
        self._answered_s = max(self._answered_s, t_s, newest_s)
        if self._ekf.has_target:
            self._live_on(t_s, fixed, proof)
        if self.searches(t_s):
            self._try_to_begin(epoch)
        elif self._sightings:
            # the search is over: what it gathered is of no use for a later one
            self._sightings.clear()
            self._initiator.reset()
        if not self._told:
            return None
        kinematics = self._ekf.kinematics_at(t_s)
        self.predictor.add(Knot(t_s=t_s, position_m=kinematics.position_runway_m))
        return kinematics

    @property
    def _told(self) -> bool:
        """Whether there is a target, and one that is reported."""
        return self._ekf.has_target and self.life.status is not TrackStatus.ACQUIRING

    def is_quiet(self, t_s: float) -> bool:
        """Return whether no pair has been answered for so long that time alone decides how the target does."""
        return t_s - max(self._answered_s, self.life.started_s) > self._coast_after_s

    def gives_up(self, t_s: float) -> bool:
        """Bring the target through a time without a pair; return whether it is to be dropped.

        What is asked of an epoch's estimate is asked of the prediction; the filter stays where it is.
        """
        if not self._ekf.has_target:
            if self.life.status is TrackStatus.ACQUIRING:
                self._change(t_s, TrackStatus.SEARCHING)
            return False
        with self._ekf.ahead(t_s):
            if self.life.is_lost(t_s, self._ekf, self._cameras):
                return True
        if self.life.is_overdue(t_s):
            self.say(t_s, "warning", "what was found has had no pictures to prove itself: dropped")
            return True
        self._change(t_s, self.life.follow(False, self._ekf))
        return False

    def state_at(self, t_s: float) -> TrackState:
        """Return how the target does at ``t_s``, its estimate predicted to there if there is one."""
        now_s = t_s if self._ekf.time_s is None else max(t_s, self._ekf.time_s)
        kinematics = self._ekf.kinematics_at(now_s) if self._told else None
        return TrackState(t_s=t_s, status=self.life.status, kinematics=kinematics)

    def _live_on(self, t_s: float, fixed: bool, proof: bool) -> None:
        """Say how the target is doing, and drop it if it is lost or was none."""
        if proof:
            self.life.fixed(t_s)
        if self.life.is_lost(t_s, self._ekf, self._cameras):
            self.drop(t_s)
        elif self.life.is_false(t_s, self._ekf):
            self.say(t_s, "warning", "what was found does not move as an aircraft does: dropped")
            self.drop(t_s)
        else:
            self._change(t_s, self.life.follow(fixed, self._ekf))

    def _try_to_begin(self, epoch: Epoch) -> None:
        """Feed this epoch's sightings to the initiator; start the filter when it finds a target."""
        recent = [s for s in self._sightings if epoch.t_s - s.t_s <= (self._window_s if s.labelled else _SIGHTING_S)]
        # labelled pixels come one by one, each at its own time: the newest of each station stand together
        labelled = {s.station: s for s in recent if s.labelled}
        self._sightings = list(labelled.values()) if len(labelled) < 2 else []
        found = self._initiator.step(epoch.t_s, [*(s for s in recent if not s.labelled), *labelled.values()])
        if found is not None:
            labels = bool(labelled) and len(labelled) == len(recent)
            word = "found in labels" if labels else "acquired"
            self._begin(epoch.t_s, found.position_runway_m, found.velocity_runway_m_s, found.covariance, word)
        elif self._ekf.has_target:
            return
        elif self._initiator.promising:
            self._change(epoch.t_s, TrackStatus.ACQUIRING)
        elif self.life.status is TrackStatus.ACQUIRING:
            self._change(epoch.t_s, TrackStatus.SEARCHING)

    def _begin(self, t_s: float, position: FloatArray, velocity: FloatArray, covariance: FloatArray, how: str) -> None:
        """Start the filter from a state as of ``t_s``; only what was acquired from candidates has to prove itself."""
        if self._ekf.has_target:
            # a better target than the one that is held: nothing learnt of that one is kept
            self._forget_looks()
        age_s = 0.0 if self._ekf.time_s is None else self._ekf.time_s - t_s
        self._ekf.start_target(position, velocity, covariance, age_s, triangulated=how != "given")
        self._initiator.reset()
        self._sightings.clear()
        self.life.started(t_s + max(age_s, 0.0), position if how == "acquired" else None)
        x, y, z = position
        self.say(t_s, "info", f"target {how} at ({x:.1f}, {y:.1f}, {z:.1f}) m")
        self._change(t_s, TrackStatus.ACQUIRING)

    def drop(self, t_s: float) -> None:
        """Give the target up: it is lost."""
        self._ekf.drop_target()
        self._forget_looks()
        self._change(t_s, TrackStatus.LOST)

    def _forget_looks(self) -> None:
        self.predictor.reset()
        for camera in self._cameras.values():
            camera.reset()

    def _change(self, t_s: float, status: TrackStatus) -> None:
        event = self.life.change(t_s, status)
        if event is not None:
            self._events.append(event)
