"""What is counted of composites, one by one and over many."""

from dataclasses import dataclass, field

import numpy as np

LATE_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class CompositeResult:
    """What the tracker made of one composite: its number, size and speed, a line on it, and what is counted."""

    number: int
    cell: tuple[int, int]
    text: str
    captured: bool
    back_s: float | None
    wrong: int
    frames: int
    missed: int
    clear: int
    elapsed_s: list[float]

    @property
    def late(self) -> bool:
        """Whether the aircraft is not hit again in time."""
        return self.back_s is None or self.back_s > LATE_S

    @property
    def failed(self) -> bool:
        """Whether there is anything to show."""
        return self.captured or self.late or self.wrong > 0


@dataclass(kw_only=True)
class CompositeCounts:
    """Counts over composites."""

    composites: int = 0
    captured: int = 0
    late: int = 0
    wrong: int = 0
    frames: int = 0
    missed: int = 0
    clear: int = 0
    back_s: list[float] = field(default_factory=list)

    def add(self, result: CompositeResult) -> None:
        """Count one composite."""
        self.composites += 1
        self.captured += result.captured
        self.late += result.late
        self.wrong += result.wrong
        self.frames += result.frames
        self.missed += result.missed
        self.clear += result.clear
        self.back_s.append(np.inf if result.back_s is None else result.back_s)

    def line(self, name: str) -> str:
        """Return one line of the printed table."""
        back = np.array(self.back_s or [0.0])
        return (
            f"{name:26s} {self.composites:5d} {self.captured:8d} {self.late:5d} {self.wrong:6d}/{self.frames:<6d}"
            f" {self.missed:5d}/{self.clear:<6d} {np.percentile(back, 95, method='higher'):7.2f} {back.max():7.2f}"
        )
