"""What a reference position, of a receiver aboard, does to the filter: in time, or late and put in its place."""

from collections.abc import Callable

import numpy as np

from groundstation.estimation.late_measurements import LateMeasurementBuffer
from groundstation.estimation.recorded_ekf import RecordedEkf
from groundstation.messages import ReferenceFix
from groundstation.tracking.track_manager import TrackManager


class ReferenceUpdate:
    """Lets reference positions correct the target and the errors that are carried; counts what it refuses.

    Parameters
    ----------
    ekf : what is corrected.
    keeper : knows whether two cameras see the target: then no position replaces it.
    window : brings the filter back for a position that comes late.
    warn : takes a warning, at a session time in s.
    """

    def __init__(
        self, ekf: RecordedEkf, keeper: TrackManager, window: LateMeasurementBuffer, warn: Callable[[float, str], None]
    ) -> None:
        self.refused = 0
        self.fused_late = 0
        self._ekf, self._keeper, self._window, self._warn = ekf, keeper, window, warn

    def take(self, fix: ReferenceFix) -> bool:
        """Fuse a position that is in time; returns whether the filter has learnt from it."""
        self._ekf.predict_to(fix.t_s)
        with self._window.decision():
            self._keeper.start_if_due(fix.t_s)
            return self._fuse(fix, 0.0)

    def take_late(self, fix: ReferenceFix) -> bool:
        """Go back to the time of a position that a receiver tells only later, and come forward again."""
        if not self._window.reaches(fix.t_s):
            return False
        self.fused_late += 1
        with self._window.late_decision(fix.t_s):
            self._ekf.predict_to(fix.t_s)
            return self._fuse(fix, fix.t_s - (self._ekf.time_s or fix.t_s))

    def _fuse(self, fix: ReferenceFix, ahead_s: float) -> bool:
        """Let a position, stamped ``ahead_s`` after the filter's time, correct a target that there is."""
        if not self._ekf.has_target:
            return False
        seen = self._keeper.life.seen_by_two(fix.t_s)
        innovation = self._ekf.update_reference(
            fix.position_runway_m, np.diag(fix.sigma_m**2), ahead_s, may_replace=not seen
        )
        self.refused += not innovation.accepted
        if seen and not innovation.accepted:
            away_m = float(np.linalg.norm(innovation.residual))
            self._warn(fix.t_s, f"reference receiver contradicts the cameras by {away_m:.1f} m: not used")
        return innovation.accepted and self._ekf.learns
