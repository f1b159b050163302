"""The sinks of a replay, and the files that it writes: results first, the Rerun recording with what room is left."""

import errno
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from groundstation.approach.approach_outputs import ApproachSummary
from groundstation.errors import InputError, os_words
from groundstation.evaluation.collector import ResultCollector
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.evaluate import Evaluation, write_reference_tums, write_summary
from groundstation.evaluation.html_report import write_report
from groundstation.evaluation.silhouettes import SilhouetteCollector
from groundstation.landing.landing_section import landing_section
from groundstation.messages import Event, StepReport
from groundstation.replay.approach_replay import ApproachReplay, approach_replay
from groundstation.replay.input_checks import InputChecks
from groundstation.replay.recording_replay import ReplayRecorder
from groundstation.replay.replay_maps import write_replay_maps
from groundstation.replay.replay_request import ReplayRequest
from groundstation.session import Session
from groundstation.sinks.output_comparison import OutputComparisonSink
from groundstation.sinks.sink import Sink
from groundstation.sinks.smoothed_track import SmoothedTrackSink
from groundstation.sinks.track_files import TrackFilesSink
from groundstation.tracking.pipeline import Pipeline

if TYPE_CHECKING:
    from groundstation.viewer.rerun_sink import RerunSink

T = TypeVar("T")
# a full disk, a full share of it, or the most that one file may have
_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


class ReplayOutputs:
    """The sinks of one replay; those of open files are closed with ``opened``.

    ``comparison`` compares the outputs with recorded ones; None without them.
    """

    def __init__(
        self, request: ReplayRequest, session: Session, comparison: OutputComparisonSink | None, opened: ExitStack
    ) -> None:
        self.collector = ResultCollector()
        self.checks = InputChecks(session.rig, session.target.span_m)
        self.recorder: ReplayRecorder | None = None
        self.approach: ApproachReplay | None = None
        self.approach_summary: ApproachSummary | None = None
        self.comparison = comparison
        self.smoothed = SmoothedTrackSink() if request.smooth else None
        self._files = opened.enter_context(TrackFilesSink(request.out))
        places = {station.name: station.ptu_position_m for station in session.rig.stations}
        self._silhouettes = SilhouetteCollector(places) if request.report and session.media else None
        self._view = _view_of(request, session)
        self._request = request
        self._room_for_tables = _ResultsFirst(self._files, self._view)

    @property
    def wants_pictures(self) -> bool:
        """Whether a sink uses the pictures of the reports."""
        return self._silhouettes is not None or (self._view is not None and self._view.wants_pictures)

    def sinks(self) -> list[Sink]:
        """Return all sinks, in the order in which they get each report."""
        optional = (self.recorder, self._view, self.smoothed, self.comparison, self._silhouettes, self.approach)
        return [self.collector, self.checks, self._room_for_tables, *(sink for sink in optional if sink is not None)]

    def taken(self, events: Iterable[Event]) -> Iterable[Event]:
        """Return the events by way of the recorder, if there is one, the input checks, and what paces them."""
        events = self.checks.watched(events if self.recorder is None else self.recorder.taken(events))
        return events if self.approach is None else self.approach.paced(events)

    def open_approach(self, session: Session, pipeline: Pipeline, from_s: float, opened: ExitStack) -> None:
        """Open the outputs of an approach that the request asks for, closed with ``opened``; before the replay."""
        self.approach = approach_replay(self._request, session, pipeline, from_s, self.sinks(), opened, view=self._view)

    def finish_approach(self) -> None:
        """End the outputs of an approach, before the sinks are closed."""
        if self.approach is not None:
            self.approach_summary = self.approach.finish()

    def smoothed_track(self) -> ResultCollector | None:
        """Return the smoothed epochs; None if no smoothing was requested."""
        return None if self.smoothed is None else self.smoothed.collected()

    @property
    def given_up(self) -> dict[Path, str]:
        """The recordings that were wanted and are not there, and why: Rerun's, and that of the pipeline's input."""
        faults = {
            self._request.out / "session.rrd": None if self._view is None else self._view.fault,
            self._request.record: None if self.recorder is None else self.recorder.fault,
        }
        return {path: fault for path, fault in faults.items() if path is not None and fault is not None}

    def discard(self) -> None:
        """Delete the draft of a Rerun recording that was not finished."""
        if self._view is not None:
            self._view.discard()

    def write(
        self, evaluation: Evaluation, smoothed_track: ResultCollector | None, config: EvaluationConfig
    ) -> tuple[Path, ...]:
        """Write the files that follow from the evaluation; returns the paths of all files of the replay."""
        request, out = self._request, self._request.out
        tables = ["track.csv", "triangulation.csv", "detections.csv", "track.tum"]
        if self.smoothed is not None:
            self._write_first(partial(self.smoothed.save, out / "smoothed.csv"))
            tables.append("smoothed.csv")
        self._write_first(lambda: write_summary(out / "summary.json", evaluation))
        results = [path.name for path in self._write_first(lambda: write_reference_tums(out, evaluation))]
        results += [path.name for path in self._write_first(lambda: write_replay_maps(out, evaluation))]
        results += ["summary.json"]
        if request.report:
            silhouettes = () if self._silhouettes is None else self._silhouettes.shown()
            landings = "" if self.approach_summary is None else landing_section(self.approach_summary.reports)
            report = partial(write_report, out / "report.html", evaluation, config, silhouettes, landings=landings)
            pages = self._write_first(report)
            results += [path.name for path in pages]
        if self._view is not None:
            from groundstation.viewer.session_view import reference_tracks

            self._view.write_reference(reference_tracks(evaluation, smoothed_track))
            self._view.close()
            if self._view.fault is None:
                tables.append("session.rrd")
        if self.approach_summary is not None:
            results += [path.name for path in self._write_first(lambda: self._write_landings(out))]
        written = [out / name for name in (*tables, *results)]
        recorded = [] if self.recorder is None or self.recorder.fault is not None else [self.recorder.path]
        return tuple(written + recorded)

    def _write_landings(self, out: Path) -> list[Path]:
        path = None if self.approach_summary is None else self.approach_summary.write(out)
        return [] if path is None else [path]

    def _write_first(self, write: Callable[[], T]) -> T:
        """Write a result; where the disk has no room for it, a second time in that of the Rerun recording."""
        try:
            return write()
        except InputError as fault:
            if not _gives_room(fault.__cause__, self._view):
                raise
            return write()


class _ResultsFirst:
    """The tables as a sink that may take the room of the Rerun recording."""

    def __init__(self, tables: TrackFilesSink, view: "RerunSink | None") -> None:
        self._tables, self._view = tables, view

    def write(self, report: StepReport) -> None:
        """Append the rows of one step; raises `OSError` where there is no room even without the recording."""
        try:
            self._tables.write(report)
        except OSError as fault:
            if not _gives_room(fault, self._view):
                raise
            self._tables.flush()

    def close(self) -> None:
        """Close the tables."""
        try:
            self._tables.flush()
        except OSError as fault:
            if not _gives_room(fault, self._view):
                raise
        self._tables.close()


def _view_of(request: ReplayRequest, session: Session) -> "RerunSink | None":
    """Open the Rerun recording, if one is wanted: without it Rerun is not imported, which takes half a second.

    That of an earlier run does not remain next to this run's track. Raises `InputError` where it cannot be removed.
    """
    if not request.rerun:
        try:
            (request.out / "session.rrd").unlink(missing_ok=True)
        except OSError as fault:
            wanted = "a folder that can be written"
            raise InputError(str(request.out / "session.rrd"), got=os_words(fault), wanted=wanted) from fault
        return None
    from groundstation.viewer.session_view import session_view

    return session_view(request.out / "session.rrd", session)


def _gives_room(fault: BaseException | None, view: "RerunSink | None") -> bool:
    """Give up the Rerun recording where a result does not fit on the disk; returns whether there was one to give up."""
    full = isinstance(fault, OSError) and fault.errno in _FULL
    return full and view is not None and view.give_up("no room left after the results")
