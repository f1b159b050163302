"""What hears a simulated station while it runs."""

from collections.abc import Callable
from typing import Protocol

from groundstation.messages import Kinematics, StepReport


class StationListener(Protocol):
    """What hears the reports and is called at each step of time, such as the stream to an autopilot."""

    def note(self, report: StepReport) -> None:
        """Note what the pipeline answered."""

    def pass_time(self, now_s: float, estimate_at: Callable[[float], Kinematics | None]) -> None:
        """Act at session time ``now_s``; ``estimate_at`` is the pipeline's."""
