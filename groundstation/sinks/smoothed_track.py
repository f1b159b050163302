"""The smoothed track: the smoother's estimate at each time of the filter's track.

It needs about 600 bytes of memory for each pair until the end: a session of one hour at 30 Hz stays below 70 MB.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from groundstation.evaluation.collector import ResultCollector
from groundstation.messages import Kinematics, StepReport, TrackEstimate, TriangulationStatus
from groundstation.sinks.track_files import write_track


class SmoothedTrackSink:
    """Requests the smoothed state at every time with an estimate; pairs without one are skipped.

    ``want`` is called with these times, `found` with the smoothed states.
    """

    def __init__(self) -> None:
        self.want: Callable[[float], None] = lambda t_s: None
        self._rows: list[TrackEstimate] = []
        self._found: dict[float, Kinematics] = {}

    def write(self, report: StepReport) -> None:
        """Keep the epochs of one step."""
        for estimate in report.estimates:
            if estimate.kinematics is not None:
                self.want(estimate.t_s)
            self._rows.append(
                replace(
                    estimate, kinematics=None, triangulation=None, triangulation_status=TriangulationStatus.ONE_VIEW
                )
            )

    def close(self) -> None:
        """Do nothing; the smoothed states arrive after this."""

    def found(self, t_s: float, kinematics: Kinematics) -> None:
        """Add one smoothed state."""
        self._found[t_s] = kinematics

    def save(self, path: Path) -> None:
        """Write the table, with track.csv's columns; raises `InputError` if the file can't be written."""
        write_track(path, self._smoothed())

    def collected(self) -> ResultCollector:
        """Return the smoothed epochs as the evaluation takes them."""
        collector = ResultCollector()
        for estimate in self._smoothed():
            collector.write(StepReport(estimates=(estimate,)))
        return collector

    def _smoothed(self) -> Iterator[TrackEstimate]:
        return (replace(row, kinematics=self._found.get(row.t_s)) for row in self._rows)
