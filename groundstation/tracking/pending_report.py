"""The results of the pipeline since its last report."""

from groundstation.messages import CameraReport, StepReport, TrackEstimate, TrackState
from groundstation.tracking.track_changes import TrackChanges

# most events give no result at once, since frames wait for their angles
_NOTHING_YET = StepReport()


class PendingReport:
    """Collects the parts of a `StepReport`, each in its order."""

    def __init__(self) -> None:
        self.cameras: list[CameraReport] = []
        self.estimates: list[TrackEstimate] = []
        self.states: list[TrackState] = []

    def take(self, changes: TrackChanges) -> StepReport:
        """Return the collected parts with the changes of the track, and clear them."""
        found = changes.events or changes.initial_pixels or changes.outcomes
        if not (self.cameras or self.estimates or self.states or found):
            return _NOTHING_YET
        report = StepReport(
            cameras=tuple(self.cameras),
            estimates=tuple(self.estimates),
            events=tuple(changes.events),
            states=tuple(self.states),
            initial_pixels=tuple(changes.initial_pixels),
            outcomes=tuple(changes.outcomes),
        )
        for part in (self.cameras, self.estimates, self.states):
            part.clear()
        return report
