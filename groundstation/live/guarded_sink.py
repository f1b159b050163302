"""A sink that a full disk disables, while tracking continues."""

from groundstation.errors import os_words
from groundstation.messages import StepReport
from groundstation.sinks.sink import Sink


class GuardedSink:
    """A sink that is disabled after a disk error, which is reported to the operator; tracking continues."""

    def __init__(self, sink: Sink, faults: list[str]) -> None:
        self._sink = sink
        # shared with other sinks
        self._faults = faults
        self._failed = False

    def write(self, report: StepReport) -> None:
        """Pass a report on, as long as the disk takes it."""
        if not self._failed:
            try:
                self._sink.write(report)
            except OSError as fault:
                self._failed = True
                self._faults.append(f"track files end here: {os_words(fault)}")

    def close(self) -> None:
        """Close the sink; an error on closing is recorded as well."""
        try:
            self._sink.close()
        except OSError as fault:
            self._faults.append(f"track files are not whole: {os_words(fault)}")
