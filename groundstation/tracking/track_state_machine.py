"""The states of a track (searching, acquiring, tracking, coasting, lost) and the conditions of their transitions.

A track is *tracking* while the pixels of two or more cameras are accepted in the same epoch (a fix), *coasting*
without fixes, and *lost* when its predicted position is too uncertain to place a region of interest in any camera, when
its existence probability is too low (`existence`), or after a configured time without an accepted pixel.

The conditions are evaluated at each epoch and, without epochs, at each heartbeat for the prediction to its time; the
track is then *coasting* from a configured time after the newest epoch on.

After a time without pixels of any camera, a single fix may be due to chance: in front of ground, each camera detects
something near an uncertain prediction. Re-acquisition therefore takes a configured number of fixes, until which the
track keeps coasting.

A target found by searching needs track confirmation. It is *acquiring*, without a reported estimate, until it has had a
fix and its velocity has converged; it is dropped as a false track if too few fixes follow, or if it does not move away
from where it was found. A confirmed track that stands still for long is dropped as well: a stopped aircraft needs no
guidance, and a detector that has lost the aircraft tends to stay on a ground feature.
"""

from collections import deque
from collections.abc import Iterable

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.ekf import StationEkf
from groundstation.messages import TrackEvent, TrackStatus
from groundstation.tracking.existence import Existence

# squared distance from the place of detection, five sigmas
_MOVED_GATE = 25.0
_POSITION_EVERY_S = 0.25


class TrackStateMachine:
    """Status of the track and the events of its changes."""

    def __init__(self, config: EstimationConfig) -> None:
        self.status = TrackStatus.SEARCHING
        self.existence = Existence(config.miss_memory_s)
        self._config = config
        self._newest_pixel_s = 0.0
        self._newest_fix_s = 0.0
        self._started_s = 0.0
        self._fixes = 0
        # fixes since the last gap without pixels
        self._fixes_since_gap = config.confirm_fixes
        self._was_fixed = False
        self._settled = False
        self._found_at: FloatArray | None = None
        # recent times and positions of a confirmed track
        self._recent_positions: deque[tuple[float, FloatArray]] | None = None

    @property
    def started_s(self) -> float:
        """Start time of the track."""
        return self._started_s

    def start(self, t_s: float, found_at_m: FloatArray | None) -> None:
        """Start a track at ``t_s``; ``found_at_m`` (3,) is the position found by searching, None for a given target."""
        self._newest_pixel_s = self._started_s = self._newest_fix_s = t_s
        self._found_at = found_at_m
        self._recent_positions = None
        self._settled = found_at_m is None
        self._fixes = 0
        self._fixes_since_gap = self._config.confirm_fixes
        self.existence.start()

    def is_false(self, t_s: float, ekf: StationEkf) -> bool:
        """Return whether a found target was not confirmed in the configured time, or is stationary since."""
        c = self._config
        if self._found_at is None:
            return self._is_stationary(t_s, ekf)
        if self._fixes < c.proof_fixes and t_s - self._started_s > c.proof_s:
            return True
        where = ekf.layout.position
        moved = ekf.state[where] - self._found_at
        significant = float(moved @ np.linalg.solve(ekf.covariance[where, where], moved)) > _MOVED_GATE
        if significant and float(np.linalg.norm(moved)) > c.false_target_m and self._fixes >= c.proof_fixes:
            self._found_at = None
            self._recent_positions = deque()
            return False
        return t_s - self._started_s > c.false_target_s

    def is_overdue(self, t_s: float) -> bool:
        """Return whether the confirmation time of a found target has passed without enough fixes."""
        c = self._config
        if self._found_at is None:
            return False
        return t_s - self._started_s > (c.proof_s if self._fixes < c.proof_fixes else c.false_target_s)

    def is_unseen(self, t_s: float) -> bool:
        """Return whether the time without an accepted pixel exceeds its limit."""
        return t_s - self._newest_pixel_s > self._config.lost_after_s

    def _is_stationary(self, t_s: float, ekf: StationEkf) -> bool:
        """Return whether a confirmed track is stationary; never true for a given target.

        A false track may wander between ground features, so that the test uses the distance over the whole time.
        """
        if self._recent_positions is None:
            return False
        c, passed, here_m = self._config, self._recent_positions, ekf.state[ekf.layout.position]
        while passed and passed[0][0] < t_s - c.standing_s - _POSITION_EVERY_S:
            passed.popleft()
        if not passed or t_s >= passed[-1][0] + _POSITION_EVERY_S:
            passed.append((t_s, here_m.copy()))
        then_s, there_m = passed[0]
        return t_s - then_s >= c.standing_s and float(np.linalg.norm(here_m - there_m)) < c.standing_m

    def add_pixel(self, t_s: float) -> None:
        """Record an accepted pixel."""
        alone = self.status is TrackStatus.COASTING and not self._was_fixed
        if alone and t_s - self._newest_pixel_s > self._config.confirm_after_s:
            self._fixes_since_gap = 0
        self._newest_pixel_s = max(self._newest_pixel_s, t_s)

    def add_fix(self, t_s: float) -> None:
        """Record a fix: accepted pixels of two or more cameras."""
        c = self._config
        # a fix in the next epoch counts, whatever the frame rate
        alone = not self._was_fixed and t_s - self._newest_fix_s > c.confirm_after_s
        if self._fixes_since_gap < c.confirm_fixes and alone:
            self._fixes_since_gap = 0
        self._newest_fix_s = t_s
        self._fixes += 1
        self._fixes_since_gap += 1

    def update(self, fixed: bool, ekf: StationEkf) -> TrackStatus:
        """Return the status of a track that is kept, with or without a fix in this epoch.

        A target found by searching is acquiring until it has had a fix and its velocity has converged.
        """
        self._was_fixed = fixed
        if not self._settled:
            where = ekf.layout.velocity
            sigma = float(np.sqrt(np.linalg.eigvalsh(ekf.covariance[where, where]).max()))
            self._settled = self._fixes > 0 and sigma < self._config.settled_velocity_sigma_m_s
        if not self._settled:
            return TrackStatus.ACQUIRING
        confirmed = fixed and self._fixes_since_gap >= self._config.confirm_fixes
        return TrackStatus.TRACKING if confirmed else TrackStatus.COASTING

    def needs_search(self, t_s: float) -> bool:
        """Return whether whole frames are also searched: the last fix is old, or the existence probability is low."""
        doubtful = self.existence.probability < self._config.doubtful_existence
        return doubtful or t_s - self._newest_fix_s > self._config.search_again_s

    def seen_by_two(self, t_s: float) -> bool:
        """Return whether two or more cameras detect the target: its last fix is at most ``search_again_s`` old."""
        return self._fixes > 0 and t_s - self._newest_fix_s <= self._config.search_again_s

    def set_status(self, t_s: float, status: TrackStatus) -> TrackEvent | None:
        """Set the status; return an event if it changed."""
        if status is self.status:
            return None
        level = "warning" if status in (TrackStatus.LOST, TrackStatus.COASTING) else "info"
        event = TrackEvent(t_s=t_s, level=level, text=f"{self.status.value} → {status.value}")
        self.status = status
        return event

    def is_lost(self, t_s: float, ekf: StationEkf, stations: Iterable[str]) -> bool:
        """Return whether the track is lost by its covariance, existence probability or time without a pixel."""
        c = self._config
        if self.existence.probability < c.lost_existence:
            return True
        if self.is_unseen(t_s):
            return True
        at, P = ekf.layout.position.start, ekf.covariance
        if P[at, at] + P[at + 1, at + 1] + P[at + 2, at + 2] > c.lost_sigma_m**2:
            return True
        # kept as long as the prediction in one camera is precise enough for a region of interest
        for name in stations:
            prediction = ekf.predict_pixel(name)
            if prediction is not None:
                S = ekf.pixel_covariance(prediction)
                if not max(S[0, 0], S[1, 1]) > c.lost_sigma_px**2:
                    return False
        return True
