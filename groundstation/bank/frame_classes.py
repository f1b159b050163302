"""Hits by what one frame shows: width of the aircraft, its signal-to-noise ratio, how much of it is seen."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from groundstation.bank.frame_outcomes import FrameOutcome
from groundstation.bank.session_truth import SessionTruth
from groundstation.sources.visibility_table import FrameVisibility

_VISIBLE, _HIT, _WRONG = "visible", "hit", "wrong"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFactor:
    """A quantity of a frame, and the classes that figures are grouped by.

    ``value`` is its quantity, ``edges`` the upper bounds of all classes but the last, in ascending order.
    """

    name: str
    unit: str
    value: Callable[[FrameVisibility], float]
    edges: tuple[float, ...]

    def class_of(self, seen: FrameVisibility) -> str:
        """Return the name of the class that a frame belongs to."""
        value, below = self.value(seen), None
        for edge in self.edges:
            if value < edge:
                return f"below {edge:g}{self.unit}" if below is None else f"{below:g} to {edge:g}{self.unit}"
            below = edge
        return f"from {self.edges[-1]:g}{self.unit}"

    @property
    def classes(self) -> tuple[str, ...]:
        """Names of all classes, ascending."""
        first, last = f"below {self.edges[0]:g}{self.unit}", f"from {self.edges[-1]:g}{self.unit}"
        inner = [f"{a:g} to {b:g}{self.unit}" for a, b in zip(self.edges, self.edges[1:], strict=False)]
        return (first, *inner, last)


FRAME_FACTORS = (
    FrameFactor(name="width", unit=" px", value=lambda seen: seen.width_px, edges=(15.0, 25.0, 50.0, 100.0, 200.0)),
    FrameFactor(name="SNR", unit="", value=lambda seen: seen.snr, edges=(15.0, 30.0, 60.0, 120.0, 250.0)),
    FrameFactor(name="share seen", unit="", value=lambda seen: seen.share_seen, edges=(0.5, 0.9, 0.999)),
)


def frame_class_row(truth: SessionTruth, outcomes: Iterable[FrameOutcome]) -> dict[str, int]:
    """Return the numbers of visible, hit and wrong frames of each class, named by `class_column`.

    Sessions of other renderers have no rated frames and give an empty row.
    """
    if not truth.rated:
        return {}
    row = {
        class_column(factor, kind, what): 0
        for factor in FRAME_FACTORS
        for kind in factor.classes
        for what in (_VISIBLE, _HIT, _WRONG)
    }
    for outcome in outcomes:
        seen = truth.rating(outcome.station, outcome.pair) if outcome.visible else None
        if seen is None:
            continue
        for factor in FRAME_FACTORS:
            kind = factor.class_of(seen)
            row[class_column(factor, kind, _VISIBLE)] += 1
            row[class_column(factor, kind, _HIT)] += outcome.hit
            row[class_column(factor, kind, _WRONG)] += outcome.wrong
    return row


def class_column(factor: FrameFactor, kind: str, what: str) -> str:
    """Return the name of a column: ``what`` is visible, hit or wrong."""
    return f"{factor.name} {kind}: {what}"
