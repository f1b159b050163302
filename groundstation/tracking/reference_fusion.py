"""Updates of the filter with reference positions of a receiver on the aircraft, in order or out of sequence."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from groundstation.estimation.late_measurements import LateMeasurementBuffer
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.updates.measurements import ReferencePosition
from groundstation.messages import ReferenceFix
from groundstation.tracking.camera_cross_check import CameraCrossCheck
from groundstation.tracking.track_manager import TrackManager


class ReferenceUpdate:
    """Updates the target and the carried errors with reference positions; counts the rejected ones.

    Parameters
    ----------
    ekf : the filter to update.
    track_manager : status of the track; while two cameras see the target, no reference position replaces it.
    late_buffer : rewinds the filter for an out-of-sequence position.
    cross_check : what the cameras triangulate, which no reference moves.
    warn : receives a session time in s and a warning.
    """

    def __init__(
        self,
        ekf: StationEkf,
        track_manager: TrackManager,
        late_buffer: LateMeasurementBuffer,
        cross_check: CameraCrossCheck,
        warn: Callable[[float, str], None],
    ) -> None:
        self.refused = 0
        self.fused_late = 0
        self._ekf, self._track_manager, self._late_buffer, self._warn = ekf, track_manager, late_buffer, warn
        self._cross_check = cross_check

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
        covariance = np.diag(fix.sigma_m**2)
        seen = self._track_manager.state_machine.seen_by_two(fix.t_s)
        # the state is of the detected point, behind the one that the receiver's position leads to
        lead_m = self._track_manager.detected_point.lead_m(
            self._ekf.kinematics_of(self._ekf.state, self._ekf.covariance)
        )
        reference = ReferencePosition(fix.position_runway_m - lead_m, covariance, ahead_s, may_replace=not seen)
        nose = self._ekf.nose_of(reference)
        contradicted = self._cross_check.contradicts(fix.t_s, nose)
        if contradicted:
            reference = replace(reference, may_replace=False, contradicted=True)
        innovation = self._ekf.update_reference(reference)
        self.refused += not innovation.accepted
        if contradicted or (seen and not innovation.accepted):
            self._report(
                fix.t_s, max(self._cross_check.distance_m(fix.t_s, nose), float(np.linalg.norm(innovation.residual)))
            )
        return innovation.accepted and self._ekf.learns

    def _report(self, t_s: float, away_m: float) -> None:
        self._warn(t_s, f"reference receiver contradicts the cameras by {away_m:.1f} m: not used")
