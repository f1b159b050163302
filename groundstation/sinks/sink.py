"""What every sink can do."""

from typing import Protocol

from groundstation.messages import StepReport


class Sink(Protocol):
    """Takes step reports as they come and closes once."""

    def write(self, report: StepReport) -> None:
        """Take one report."""

    def close(self) -> None:
        """Write what is still held and let go of all files."""
