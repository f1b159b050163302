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
    # number of the newest track, and whether its outcome is open
    track_id: int = 0
    _is_open: bool = False

    def start(self, pixels: Sequence[InitialPixel]) -> None:
        """Note a new track and the pixels that it was found by; it displaces one that was not confirmed."""
        self.decide(OutcomeKind.DISPLACED)
        self.track_id += 1
        self._is_open = True
        self.initial_pixels += [replace(pixel, track_id=self.track_id) for pixel in pixels]

    def decide(self, kind: OutcomeKind) -> None:
        """Note the outcome of the track, unless there has been one."""
        if self._is_open:
            self.outcomes.append(TrackOutcome(track_id=self.track_id, kind=kind))
            self._is_open = False

    def take(self) -> "TrackChanges":
        """Return the changes so far, and forget them."""
        taken = TrackChanges(self.events, self.initial_pixels, self.outcomes)
        self.events, self.initial_pixels, self.outcomes = [], [], []
        return taken

    def after_reset(self) -> "TrackChanges":
        """Return the changes for a new filter: an open track is dropped, and later tracks have other numbers."""
        self.decide(OutcomeKind.DROPPED)
        return self
