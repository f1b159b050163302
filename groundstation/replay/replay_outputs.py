"""The sinks of a replay, and the files that it writes."""

from contextlib import ExitStack
from pathlib import Path

from groundstation.evaluation.collector import ResultCollector
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.evaluate import Evaluation, write_reference_tums, write_summary
from groundstation.evaluation.html_report import write_report
from groundstation.evaluation.silhouettes import SilhouetteCollector
from groundstation.recording.recorder import Recorder
from groundstation.replay.input_checks import InputChecks
from groundstation.replay.replay_maps import write_replay_maps
from groundstation.replay.replay_request import ReplayRequest
from groundstation.session import Session
from groundstation.sinks.output_comparison import OutputComparisonSink
from groundstation.sinks.sink import Sink
from groundstation.sinks.smoothed_track import SmoothedTrackSink
from groundstation.sinks.track_files import TrackFilesSink
from groundstation.viewer.session_view import reference_tracks, session_view


class ReplayOutputs:
    """The sinks of one replay; those of open files are closed with ``opened``.

    ``comparison`` compares the outputs with recorded ones; None without them.
    """

    def __init__(
        self, request: ReplayRequest, session: Session, comparison: OutputComparisonSink | None, opened: ExitStack
    ) -> None:
        self.collector = ResultCollector()
        self.checks = InputChecks(session.rig)
        self.recorder: Recorder | None = None
        self.comparison = comparison
        self.smoothed = SmoothedTrackSink() if request.smooth else None
        self._files = opened.enter_context(TrackFilesSink(request.out))
        places = {station.name: station.ptu_position_m for station in session.rig.stations}
        self._silhouettes = SilhouetteCollector(places) if request.report and session.media else None
        self._view = session_view(request.out / "session.rrd", session) if request.rerun else None
        self._request = request

    @property
    def wants_pictures(self) -> bool:
        """Whether a sink uses the pictures of the reports."""
        return self._silhouettes is not None or (self._view is not None and self._view.wants_pictures)

    def sinks(self) -> list[Sink]:
        """Return all sinks, in the order in which they get each report."""
        optional = (self.recorder, self._view, self.smoothed, self.comparison, self._silhouettes)
        return [self.collector, self.checks, self._files, *(sink for sink in optional if sink is not None)]

    def smoothed_track(self) -> ResultCollector | None:
        """Return the smoothed epochs; None if no smoothing was requested."""
        return None if self.smoothed is None else self.smoothed.collected()

    def write(
        self, evaluation: Evaluation, smoothed_track: ResultCollector | None, config: EvaluationConfig
    ) -> tuple[Path, ...]:
        """Write the files that follow from the evaluation; returns the paths of all files of the replay."""
        request, out = self._request, self._request.out
        written = ["track.csv", "triangulation.csv", "detections.csv", "track.tum"]
        if self.smoothed is not None:
            self.smoothed.save(out / "smoothed.csv")
            written.append("smoothed.csv")
        if self._view is not None:
            self._view.write_reference(reference_tracks(evaluation, smoothed_track))
            self._view.close()
            written.append("session.rrd")
        write_summary(out / "summary.json", evaluation)
        written += [path.name for path in write_reference_tums(out, evaluation)]
        written += [path.name for path in write_replay_maps(out, evaluation)]
        written += ["summary.json"]
        if request.report:
            silhouettes = () if self._silhouettes is None else self._silhouettes.shown()
            written += [path.name for path in write_report(out / "report.html", evaluation, config, silhouettes)]
        return tuple([out / name for name in written] + ([] if request.record is None else [request.record]))
