"""The states of a track (searching, acquiring, tracking, coasting, lost) and the conditions of their transitions.

A track is *tracking* while the pixels of two or more cameras are accepted in the same epoch (a fix), *coasting*
without fixes, and *lost* when its predicted position is too uncertain to place a region of interest in any camera, when
its existence probability is too low (`existence_probability`), or after a configured time without an accepted pixel.

The conditions are evaluated at each epoch and, without epochs, at each heartbeat for the prediction to its time; the
track is then *coasting* from a configured time after the newest epoch on.

After a time without pixels of any camera, a single fix may be due to chance: in front of ground, each camera detects
something near an uncertain prediction. Re-acquisition therefore takes a configured number of fixes, until which the
track keeps coasting.

A target found by searching needs track confirmation (`track_confirmation`). It is *acquiring*, without a reported
estimate, until it has had a fix and its velocity has converged and is not zero; it is dropped if it proves to be a
false track.
"""

from collections.abc import Iterable

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.station_ekf import StationEkf
from groundstation.messages import TrackEvent, TrackStatus
from groundstation.tracking.existence_probability import ExistenceProbability
from groundstation.tracking.recognition import Recognition
from groundstation.tracking.track_confirmation import TrackConfirmation


class TrackStateMachine:
    """Status of the track, its existence probability and confirmation, and the events of its status changes."""

    def __init__(self, config: EstimationConfig) -> None:
        self.status = TrackStatus.SEARCHING
        self.existence = ExistenceProbability(config.miss_memory_s)
        self.confirmation = TrackConfirmation(config)
        self.recognition = Recognition()
        self._config = config
        self._newest_pixel_s = 0.0
        self._newest_fix_s = 0.0
        self._started_s = 0.0
        # fixes since the last gap without pixels
        self._fixes_since_gap = config.confirm_fixes
        self._was_fixed = False

    @property
    def started_s(self) -> float:
        """Start time of the track."""
        return self._started_s

    def start(
        self,
        t_s: float,
        found_at_m: FloatArray | None,
        *,
        known: bool = False,
        standing: bool = False,
        odds: float | None = None,
    ) -> None:
        """Start a track at ``t_s``; ``found_at_m`` (3,) is the position found by searching, None for a given target.

        ``known``: of a target that was confirmed before, which stays recognised as it was; ``standing``: found without
        motion; ``odds``: mean log odds of aircraft of the candidates found, None without them.
        """
        self._newest_pixel_s = self._started_s = self._newest_fix_s = t_s
        self.confirmation.start(t_s, found_at_m, known=known, standing=standing)
        if not known:
            self.recognition.start(t_s, odds)
        self._fixes_since_gap = self._config.confirm_fixes
        self.existence.start()

    def is_unseen(self, t_s: float) -> bool:
        """Return whether the time without an accepted pixel exceeds its limit."""
        return t_s - self._newest_pixel_s > self._config.lost_after_s

    def is_missed(self, t_s: float) -> bool:
        """Return whether no camera has seen a target for ``search_again_s`` that two have seen since its start."""
        return self.confirmation.has_fix and t_s - self._newest_pixel_s > self._config.search_again_s

    def add_pixel(self, t_s: float) -> None:
        """Record an accepted pixel."""
        alone = self.status is TrackStatus.COASTING and not self._was_fixed
        if alone and t_s - self._newest_pixel_s > self._config.confirm_after_s:
            self._fixes_since_gap = 0
        self._newest_pixel_s = max(self._newest_pixel_s, t_s)

    def add_fix(self, t_s: float) -> None:
        """Record a fix: accepted pixels of two or more cameras; of what stands recognised also of cut silhouettes."""
        c = self._config
        # a fix in the next epoch counts, whatever the frame rate
        alone = not self._was_fixed and t_s - self._newest_fix_s > c.confirm_after_s
        if self._fixes_since_gap < c.confirm_fixes and alone:
            self._fixes_since_gap = 0
        self._newest_fix_s = t_s
        self.confirmation.add_fix()
        self._fixes_since_gap += 1

    def update(self, fixed: bool, ekf: StationEkf) -> TrackStatus:
        """Return the status of a track that is kept, with or without a fix in this epoch.

        A target found by searching is acquiring until it has had a fix, and its velocity has converged and is not zero.
        """
        self._was_fixed = fixed
        if not self.confirmation.is_reportable(ekf, recognised=self.recognition.is_recognised):
            return TrackStatus.ACQUIRING
        confirmed = fixed and self._fixes_since_gap >= self._config.confirm_fixes
        return TrackStatus.TRACKING if confirmed else TrackStatus.COASTING

    def needs_search(self, t_s: float) -> bool:
        """Return whether whole frames are also searched: the target is doubtful, or could yield to another one."""
        own = self.recognition
        found = self.confirmation
        sure = not own.is_available or (own.is_recognised and not found.is_standing and found.has_settled)
        return self.is_doubtful(t_s) or not sure

    def is_doubtful(self, t_s: float) -> bool:
        """Return whether the last fix is old, or the existence probability is low."""
        doubtful = self.existence.probability < self._config.doubtful_existence
        return doubtful or t_s - self._newest_fix_s > self._config.search_again_s

    def is_likelier_than(self, t_s: float, odds: float | None) -> bool:
        """Return whether a camera has just seen the target, and it is far likelier an aircraft than another one.

        The other one has mean log ``odds`` of aircraft. That a second camera has lost sight of the target is no reason
        to give it up for a bird.
        """
        seen = t_s - self._newest_pixel_s <= self._config.confirm_after_s
        return seen and self.recognition.is_likelier_than(odds)

    def yields_to(
        self,
        *,
        recognised: bool,
        moving_s: float | None,
        odds: float | None = None,
        far_nearer: bool = False,
    ) -> bool:
        """Return whether the target is given up for another one that is recognised, or has moved for ``moving_s``.

        One that moves yields to another that moves and is recognised, if it is not itself. One that stands yields to
        each that moves and is recognised; one that stands and is not recognised, to each; one that stands and is, to
        what has moved for as long as a found target has to move. Of two aircraft the one that lands is nearer than the
        traffic and the horizon behind it: one that stands, or whose velocity has not settled, yields to one that is
        ``far_nearer``, if it is about as likely to be an aircraft by its mean log ``odds`` (birds are nearer, too).
        """
        known, nearer = self.recognition.is_recognised, far_nearer and not self.recognition.is_likelier_than(odds)
        if not self.confirmation.is_standing:
            rival = nearer and not self.confirmation.has_settled if known else True
            return moving_s is not None and recognised and rival
        if moving_s is None:
            return recognised and (not known or nearer)
        return recognised or not known or moving_s > self._config.false_target_s

    def seen_by_two(self, t_s: float) -> bool:
        """Return whether two or more cameras detect the target: its last fix is at most ``search_again_s`` old."""
        return self.confirmation.has_fix and t_s - self._newest_fix_s <= self._config.search_again_s

    def set_status(self, t_s: float, status: TrackStatus) -> TrackEvent | None:
        """Set the status; return an event if it changed."""
        if status is self.status:
            return None
        worse = status in (TrackStatus.LOST, TrackStatus.COASTING)
        # an estimate was reported until now
        ends = self.status in (TrackStatus.TRACKING, TrackStatus.COASTING) and status is not TrackStatus.TRACKING
        level = "warning" if worse or ends else "info"
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
        # one camera that sees it holds its direction, whatever becomes of the range
        unseen = t_s - self._newest_pixel_s > c.confirm_after_s
        if unseen and P[at, at] + P[at + 1, at + 1] + P[at + 2, at + 2] > c.lost_sigma_m**2:
            return True
        # kept as long as the prediction in one camera is precise enough for a region of interest
        for name in stations:
            prediction = ekf.predict_pixel(name)
            if prediction is not None:
                S = ekf.pixel_covariance(prediction)
                if not max(S[0, 0], S[1, 1]) > c.lost_sigma_px**2:
                    return False
        return True
