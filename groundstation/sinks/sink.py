"""The interface of all sinks."""

from typing import Protocol

from groundstation.messages import StepReport


class Sink(Protocol):
    """Receives step reports and is closed once."""

    def write(self, report: StepReport) -> None:
        """Add one report."""

    def close(self) -> None:
        """Write all buffered data and close the files."""
