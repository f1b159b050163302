"""What the motion of a station's pictures says against its readings, in words."""

from collections.abc import Sequence
from dataclasses import dataclass

from groundstation.integrity.motion_scale import MotionScale
from groundstation.integrity.reading_hypothesis import GRADIAN_DEG, ReadingHypothesis

# a factor so close to a gradian's is named as it
_SAME_UNIT, _IN_GRADIANS = 0.03, ". Are the angles in gradians?"


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadMotionFault:
    """Readings of a station that contradict the motion of its pictures.

    ``hypothesis`` agrees with ``agreeing`` of ``pairs`` pairs, and is None if none does; the readings as they are agree
    with ``agreeing_as_stored`` of ``pairs_as_stored``. ``scale`` is by what all motions are off where most pairs agree;
    ``same`` is the number of pairs of one and the same picture, if these are the fault.
    """

    station: str
    hypothesis: ReadingHypothesis | None
    pairs: int
    agreeing: int
    agreeing_as_stored: int
    pairs_as_stored: int
    scale: MotionScale | None = None
    same: int = 0

    def line(self) -> str:
        """Return the fault as a line for people."""
        if self.scale is not None:
            times = f"{self.scale.ratio:.3f} ± {self.scale.sigma:.3f} times"
            unit = abs(self.scale.ratio / GRADIAN_DEG - 1.0) <= _SAME_UNIT
            return (
                f"station {self.station}: its pictures move {times} as far as its head's angles and its focal length "
                f"say ({self.scale.pairs} pairs of pictures): one of these is wrong{_IN_GRADIANS if unit else ''}"
            )
        if self.same:
            return (
                f"station {self.station}: {self.same} of {self.pairs_as_stored} pairs of its pictures are one and the "
                f"same while its head turns by its angles: its video or its camera is frozen"
            )
        text = (
            f"station {self.station}: its pictures do not move as its head's angles say "
            f"({self.agreeing_as_stored} of {self.pairs_as_stored} pairs of pictures agree)"
        )
        if self.hypothesis is None:
            return f"{text}: readings, mount or focal length are wrong"
        line = f"{text}; they do with {self.hypothesis.words()} ({self.agreeing} of {self.pairs})"
        if self.hypothesis.axes_changed:
            # both turn the picture about the optical axis, and motion alone does not tell them apart
            line += ", or with another mount: is its quaternion w, x, y, z?"
        return line


def fault_lines(faults: Sequence[HeadMotionFault]) -> tuple[str, ...]:
    """Return a line on each fault, and one on two stations of which each has the other's readings."""
    source = {fault.station: fault.hypothesis.source for fault in faults if fault.hypothesis is not None}
    lines = []
    for fault in faults:
        other = source.get(fault.station)
        if other is None or source.get(other) != fault.station:
            lines.append(fault.line())
        elif fault.station < other:
            lines.append(
                f"stations {fault.station} and {other}: the pictures of each move as the other's head turns "
                f"({fault.agreeing} of {fault.pairs} pairs of pictures agree so, {fault.agreeing_as_stored} of "
                f"{fault.pairs_as_stored} as stored): their angles or their videos are exchanged"
            )
    return tuple(lines)
