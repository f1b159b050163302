"""Stretches of a table of angles without a reading: pictures of that time have no angles."""

from collections.abc import Mapping
from dataclasses import dataclass, field

# of each station the longest are kept, and so many of all are named
_MOST_KEPT, _MOST_NAMED = 20, 2


@dataclass(slots=True)
class ReadingGaps:
    """First and last reading of one head, and the longest stretches between two that follow each other.

    Times are in s; a stretch is (from, to).
    """

    first_s: float | None = None
    last_s: float | None = None
    _longest: list[tuple[float, float]] = field(default_factory=list)

    def add(self, t_s: float) -> None:
        """Take the time of the next reading."""
        before, self.last_s = self.last_s, t_s
        if before is None:
            self.first_s = t_s
            return
        gaps = self._longest
        if len(gaps) == _MOST_KEPT:
            if t_s - before <= _length(gaps[-1]):
                return
            gaps.pop()
        gaps.append((before, t_s))
        gaps.sort(key=_length, reverse=True)

    def within(self, from_s: float, to_s: float, most_apart_s: float) -> list[tuple[float, float]]:
        """Return the stretches longer than ``most_apart_s`` of a span, and of its ends."""
        if self.first_s is None or self.last_s is None:
            return [(from_s, to_s)]
        gaps = [gap for gap in self._longest if gap[1] > from_s and gap[0] < to_s]
        gaps += [(from_s, self.first_s)] if self.first_s > from_s else []
        gaps += [(self.last_s, to_s)] if self.last_s < to_s else []
        return [gap for gap in gaps if _length(gap) > most_apart_s]


def gap_notes(
    gaps: Mapping[str, ReadingGaps], file: str, span_s: tuple[float, float], most_apart_s: float
) -> list[str]:
    """Return a note on each of the longest stretches of a span in which stations have no readings.

    ``gaps`` are by station; between readings further apart than ``most_apart_s`` nothing is interpolated.
    """
    stations: dict[tuple[float, float], list[str]] = {}
    for name, found in gaps.items():
        for gap in found.within(*span_s, most_apart_s):
            stations.setdefault(gap, []).append(name)
    longest = sorted(stations, key=_length, reverse=True)
    notes = []
    for gap in sorted(longest[:_MOST_NAMED]):
        names = " and ".join(stations[gap])
        notes.append(
            f"{file}: no readings of {names} from {gap[0]:.2f} to {gap[1]:.2f} s: pictures have no angles there"
        )
    if len(longest) > _MOST_NAMED:
        more = len(longest) - _MOST_NAMED
        notes.append(f"{file}: {more} or more other stretches of over {most_apart_s:g} s without readings")
    return notes


def _length(gap: tuple[float, float]) -> float:
    return gap[1] - gap[0]
