"""Hypotheses of what is exchanged or stored wrongly in a whole session, for its stations' rays to meet."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from groundstation.integrity.reading_hypothesis import ReadingHypothesis

# ratios of the true focal length to the stated one that are tried
FOCAL_FACTORS = np.geomspace(0.05, 20.0, 53)


@dataclass(frozen=True, slots=True, kw_only=True)
class RayHypothesis:
    """A hypothesis on all stations: ``readings`` of those that turn, and what of two stations is exchanged.

    ``pixels_exchanged``: their pixels; ``places_exchanged``: where they stand; ``lenses_exchanged``: their lenses.
    With pixels and readings exchanged each is what the rig states of the other.
    """

    readings: Mapping[str, ReadingHypothesis] = field(default_factory=dict)
    pixels_exchanged: tuple[str, str] | None = None
    places_exchanged: tuple[str, str] | None = None
    lenses_exchanged: tuple[str, str] | None = None

    def kind(self) -> tuple[object, ...]:
        """Return what is changed, without by how much."""
        exchanged = (self.pixels_exchanged, self.places_exchanged, self.lenses_exchanged)
        return (*exchanged, *((name, h.kind()) for name, h in self.readings.items()))

    def is_endless(self) -> bool:
        """Return whether it is the longest focal length tried: with it pixels have no effect, whatever is wrong."""
        return any(reading.focal_factor == FOCAL_FACTORS[-1] for reading in self.readings.values())

    def is_refuted(self, refuted: Callable[[str, ReadingHypothesis], bool]) -> bool:
        """Return whether a station's own pictures speak against it; with exchanged pixels they are another's."""
        own = () if self.pixels_exchanged is not None else self.readings.items()
        return any(refuted(name, reading) for name, reading in own)

    def words(self) -> str:
        """Return what would have to be changed, for a message: "with …"."""
        if self.lenses_exchanged is not None:
            return "the lenses of {} and {} exchanged".format(*self.lenses_exchanged)
        if self.pixels_exchanged is not None:
            what = "stations {} and {} of the rig" if self.readings else "the videos or the pixels of {} and {}"
            return f"{what.format(*self.pixels_exchanged)} exchanged"
        if self.places_exchanged is not None:
            return "the places of {} and {} exchanged".format(*self.places_exchanged)
        sources = [h.source for h in self.readings.values() if h.source is not None]
        if len(sources) > 1:
            return f"the angles of {' and '.join(sorted(sources))} exchanged"
        changed = {name: h.words() for name, h in self.readings.items() if h.words()}
        if len(set(changed.values())) == 1 and len(changed) > 1:
            return next(iter(changed.values()))
        return " and ".join(f"{words} for station {name}" for name, words in changed.items())
