"""What happened to the track since the last report: log events, the pixels that it was found by, its outcome."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from groundstation.messages import InitialPixel, OutcomeKind, TrackEvent, TrackOutcome


@dataclass(slots=True)
class TrackChanges:
    """Collects the changes of one track after another, each in its order."""

    events: list[TrackEvent] = field(default_factory=list)
    initial_pixels: list[InitialPixel] = field(default_factory=list)
    outcomes: list[TrackOutcome] = field(default_factory=list)
    # start of the track whose outcome is open
    _open_s: float | None = None

    def start(self, track_start_s: float, pixels: Sequence[InitialPixel]) -> None:
        """Note a new track and the pixels that it was found by; it displaces one that was not confirmed."""
        self.decide(OutcomeKind.DISPLACED)
        self._open_s = track_start_s
        self.initial_pixels += [replace(pixel, track_start_s=track_start_s) for pixel in pixels]

    def decide(self, kind: OutcomeKind) -> None:
        """Note the outcome of the track, unless there has been one."""
        if self._open_s is not None:
            self.outcomes.append(TrackOutcome(track_start_s=self._open_s, kind=kind))
            self._open_s = None

    def take(self) -> "TrackChanges":
        """Return the changes so far, and forget them."""
        taken = TrackChanges(self.events, self.initial_pixels, self.outcomes)
        self.events, self.initial_pixels, self.outcomes = [], [], []
        return taken
