"""The life of a track: searching, acquiring, tracking, coasting, lost; and when which is said.

A track is *tracking* while two or more cameras' pixels are accepted in the same epoch (a fix), *coasting*
while it lives without, and *lost* when its covariance says that the cameras could no longer be told where to
look, when it has not been where it should have been seen (`existence`), or at the latest after a stated
time without any accepted pixel.

All of this is asked at each pair, and where no pair comes at each heartbeat, of the prediction for that time; the track
is *coasting* then from a stated time after the newest pair on.

Once no camera has had a pixel for a while, one pair of pixels that agree may be chance: on ground, each camera finds
something near a vague prediction. So the track goes on coasting until as many fixes as were asked for have come.

A target that was found by searching has to prove itself. It is *acquiring*, without an estimate, until it has had
a fix and its velocity has settled; it is dropped as false if a few fixes do not come soon, or if it does not move
away from where it was found. So is one that has proved itself and then stands still for long: an aeroplane that has
stopped needs no guidance, and what the cameras cling to after it has gone is ground.
"""

from collections import deque
from collections.abc import Iterable

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.ekf import StationEkf
from groundstation.messages import TrackEvent, TrackStatus
from groundstation.tracking.existence import Existence

# five sigmas
_MOVED_SQUARE = 25.0
_PASSED_EVERY_S = 0.25


class TrackStateMachine:
    """Status of the one track, and the events of its changes."""

    def __init__(self, config: EstimationConfig) -> None:
        self.status = TrackStatus.SEARCHING
        self.existence = Existence(config.miss_memory_s)
        self._config = config
        self._newest_pixel_s = 0.0
        self._newest_fix_s = 0.0
        self._started_s = 0.0
        self._fixes = 0
        # fixes since the cameras had nothing for a while
        self._fixes_back = config.confirm_fixes
        self._was_fixed = False
        self._settled = False
        self._found_at: FloatArray | None = None
        # where a target that proved itself has lately been, and when
        self._passed: deque[tuple[float, FloatArray]] | None = None

    @property
    def started_s(self) -> float:
        """When the target was begun."""
        return self._started_s

    def started(self, t_s: float, found_at_m: FloatArray | None) -> None:
        """Note that a target was begun at ``t_s``; ``found_at_m`` (3,) where searching found it, None if given."""
        self._newest_pixel_s = self._started_s = self._newest_fix_s = t_s
        self._found_at = found_at_m
        self._passed = None
        self._settled = found_at_m is None
        self._fixes = 0
        self._fixes_back = self._config.confirm_fixes
        self.existence.start()

    def is_false(self, t_s: float, ekf: StationEkf) -> bool:
        """Return whether a found target has failed to prove itself in the time it was given, or stands still since."""
        c = self._config
        if self._found_at is None:
            return self._stands(t_s, ekf)
        if self._fixes < c.proof_fixes and t_s - self._started_s > c.proof_s:
            return True
        where = ekf.layout.position
        moved = ekf.state[where] - self._found_at
        significant = float(moved @ np.linalg.solve(ekf.covariance[where, where], moved)) > _MOVED_SQUARE
        if significant and float(np.linalg.norm(moved)) > c.false_target_m and self._fixes >= c.proof_fixes:
            self._found_at = None
            self._passed = deque()
            return False
        return t_s - self._started_s > c.false_target_s

    def is_overdue(self, t_s: float) -> bool:
        """Return whether a found target has had its time to prove itself, and has not; it takes pictures to do so."""
        c = self._config
        if self._found_at is None:
            return False
        return t_s - self._started_s > (c.proof_s if self._fixes < c.proof_fixes else c.false_target_s)

    def is_unseen(self, t_s: float) -> bool:
        """Return whether no pixel has been accepted for so long that the target is lost, however certain it seems."""
        return t_s - self._newest_pixel_s > self._config.lost_after_s

    def _stands(self, t_s: float, ekf: StationEkf) -> bool:
        """Return whether a target that has proved itself has for long got nowhere; never a given one.

        What cameras cling to may wander among what the ground shows: what counts is how far it comes in the time.
        """
        if self._passed is None:
            return False
        c, passed, here_m = self._config, self._passed, ekf.state[ekf.layout.position]
        while passed and passed[0][0] < t_s - c.standing_s - _PASSED_EVERY_S:
            passed.popleft()
        if not passed or t_s >= passed[-1][0] + _PASSED_EVERY_S:
            passed.append((t_s, here_m.copy()))
        then_s, there_m = passed[0]
        return t_s - then_s >= c.standing_s and float(np.linalg.norm(here_m - there_m)) < c.standing_m

    def saw(self, t_s: float) -> None:
        """Note that a pixel was accepted."""
        alone = self.status is TrackStatus.COASTING and not self._was_fixed
        if alone and t_s - self._newest_pixel_s > self._config.confirm_after_s:
            self._fixes_back = 0
        self._newest_pixel_s = max(self._newest_pixel_s, t_s)

    def fixed(self, t_s: float) -> None:
        """Note that two or more cameras agreed."""
        c = self._config
        # however slow the pictures come, the next epoch's fix confirms
        alone = not self._was_fixed and t_s - self._newest_fix_s > c.confirm_after_s
        if self._fixes_back < c.confirm_fixes and alone:
            self._fixes_back = 0
        self._newest_fix_s = t_s
        self._fixes += 1
        self._fixes_back += 1

    def follow(self, fixed: bool, ekf: StationEkf) -> TrackStatus:
        """Return the status of a target that lives on, with or without a fix in this epoch.

        What was found by searching is acquiring until it has had a fix and its velocity has settled.
        """
        self._was_fixed = fixed
        if not self._settled:
            where = ekf.layout.velocity
            sigma = float(np.sqrt(np.linalg.eigvalsh(ekf.covariance[where, where]).max()))
            self._settled = self._fixes > 0 and sigma < self._config.settled_velocity_sigma_m_s
        if not self._settled:
            return TrackStatus.ACQUIRING
        confirmed = fixed and self._fixes_back >= self._config.confirm_fixes
        return TrackStatus.TRACKING if confirmed else TrackStatus.COASTING

    def needs_search(self, t_s: float) -> bool:
        """Return whether the whole frames are searched beside the prediction: the last fix is old, or belief small."""
        doubtful = self.existence.probability < self._config.doubtful_existence
        return doubtful or t_s - self._newest_fix_s > self._config.search_again_s

    def seen_by_two(self, t_s: float) -> bool:
        """Return whether two cameras or more see the target: a fix of it is at most ``search_again_s`` old."""
        return self._fixes > 0 and t_s - self._newest_fix_s <= self._config.search_again_s

    def change(self, t_s: float, status: TrackStatus) -> TrackEvent | None:
        """Set the status; return an event if it is another."""
        if status is self.status:
            return None
        level = "warning" if status in (TrackStatus.LOST, TrackStatus.COASTING) else "info"
        event = TrackEvent(t_s=t_s, level=level, text=f"{self.status.value} → {status.value}")
        self.status = status
        return event

    def is_lost(self, t_s: float, ekf: StationEkf, stations: Iterable[str]) -> bool:
        """Return whether the covariance, the looks in vain, or the time without a pixel says that it is lost."""
        c = self._config
        if self.existence.probability < c.lost_existence:
            return True
        if self.is_unseen(t_s):
            return True
        at, P = ekf.layout.position.start, ekf.covariance
        if P[at, at] + P[at + 1, at + 1] + P[at + 2, at + 2] > c.lost_sigma_m**2:
            return True
        # it is held as long as one camera could be told where to look
        for name in stations:
            prediction = ekf.predict_pixel(name)
            if prediction is not None:
                S = ekf.pixel_covariance(prediction)
                if not max(S[0, 0], S[1, 1]) > c.lost_sigma_px**2:
                    return False
        return True
