"""What happened to the track since the last report: log events, the pixels that it was found by, its outcome."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from groundstation.messages import InitialPixel, TrackEvent, TrackOutcome


@dataclass(slots=True)
class TrackChanges:
    """Collects the changes of one track after another, each in its order."""

    events: list[TrackEvent] = field(default_factory=list)
    initial_pixels: list[InitialPixel] = field(default_factory=list)
    outcomes: list[TrackOutcome] = field(default_factory=list)
    # start of the track that is neither confirmed nor withdrawn
    _open_s: float | None = None

    def start(self, track_s: float, pixels: Sequence[InitialPixel]) -> None:
        """Note a new track and the pixels that it was found by; one that was not confirmed yet is withdrawn."""
        self.decide(confirmed=False)
        self._open_s = track_s
        self.initial_pixels += [replace(pixel, track_s=track_s) for pixel in pixels]

    def decide(self, *, confirmed: bool) -> None:
        """Note that the track is confirmed or withdrawn, unless that has been decided."""
        if self._open_s is not None:
            self.outcomes.append(TrackOutcome(track_s=self._open_s, confirmed=confirmed))
            self._open_s = None

    def take(self) -> "TrackChanges":
        """Return the changes so far, and forget them."""
        taken = TrackChanges(self.events, self.initial_pixels, self.outcomes)
        self.events, self.initial_pixels, self.outcomes = [], [], []
        return taken
