"""Updates of the filter with reference positions of a receiver on the aircraft, in order or out of sequence."""

from collections.abc import Callable

import numpy as np

from groundstation.estimation.late_measurements import LateMeasurementBuffer
from groundstation.estimation.station_ekf import StationEkf
from groundstation.messages import ReferenceFix
from groundstation.tracking.track_manager import TrackManager


class ReferenceUpdate:
    """Updates the target and the carried errors with reference positions; counts the rejected ones.

    Parameters
    ----------
    ekf : the filter to update.
    track_manager : status of the track; while two cameras see the target, no reference position replaces it.
    late_buffer : rewinds the filter for an out-of-sequence position.
    warn : receives a session time in s and a warning.
    """

    def __init__(
        self,
        ekf: StationEkf,
        track_manager: TrackManager,
        late_buffer: LateMeasurementBuffer,
        warn: Callable[[float, str], None],
    ) -> None:
        self.refused = 0
        self.fused_late = 0
        self._ekf, self._track_manager, self._late_buffer, self._warn = ekf, track_manager, late_buffer, warn

    def take(self, fix: ReferenceFix) -> bool:
        """Fuse a position in order of time; return whether the carried errors were estimated with it."""
        self._ekf.predict_to(fix.t_s)
        with self._late_buffer.decision():
            self._track_manager.start_if_due(fix.t_s)
            return self._fuse(fix, 0.0)

    def take_late(self, fix: ReferenceFix) -> bool:
        """Fuse an out-of-sequence position at its own time; return whether the carried errors were estimated."""
        if not self._late_buffer.reaches(fix.t_s):
            return False
        self.fused_late += 1
        with self._late_buffer.late_decision(fix.t_s):
            self._ekf.predict_to(fix.t_s)
            return self._fuse(fix, fix.t_s - (self._ekf.time_s or fix.t_s))

    def _fuse(self, fix: ReferenceFix, ahead_s: float) -> bool:
        """Fuse a position stamped ``ahead_s`` after the filter time, if there is a target."""
        if not self._ekf.has_target:
            return False
        seen = self._track_manager.state_machine.seen_by_two(fix.t_s)
        innovation = self._ekf.update_reference(
            fix.position_runway_m, np.diag(fix.sigma_m**2), ahead_s, may_replace=not seen
        )
        self.refused += not innovation.accepted
        if seen and not innovation.accepted:
            away_m = float(np.linalg.norm(innovation.residual))
            self._warn(fix.t_s, f"reference receiver contradicts the cameras by {away_m:.1f} m: not used")
        return innovation.accepted and self._ekf.learns
