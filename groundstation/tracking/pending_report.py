"""The results of the pipeline since its last report."""

from collections.abc import Sequence

from groundstation.messages import CameraReport, InitialPixel, StepReport, TrackEstimate, TrackEvent, TrackState

# most events give no result at once, since frames wait for their angles
_NOTHING_YET = StepReport()


class PendingReport:
    """Collects the parts of a `StepReport`, each in its order."""

    def __init__(self) -> None:
        self.cameras: list[CameraReport] = []
        self.estimates: list[TrackEstimate] = []
        self.states: list[TrackState] = []
        self.initial_pixels: list[InitialPixel] = []

    def take(self, events: Sequence[TrackEvent]) -> StepReport:
        """Return the collected parts with ``events``, and clear them."""
        if not (self.cameras or self.estimates or self.states or self.initial_pixels or events):
            return _NOTHING_YET
        report = StepReport(
            cameras=tuple(self.cameras),
            estimates=tuple(self.estimates),
            events=tuple(events),
            states=tuple(self.states),
            initial_pixels=tuple(self.initial_pixels),
        )
        for part in (self.cameras, self.estimates, self.states, self.initial_pixels):
            part.clear()
        return report
