"""Replaying a recorded session: load, track, write the result files, evaluate, report.

A fault in the recording ends the run early; the results up to it are written, and the fault is returned.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.errors import InputError, RigError, SessionError
from groundstation.evaluation.collector import ResultCollector
from groundstation.evaluation.evaluate import Evaluation, evaluate_run, write_reference_tums, write_summary
from groundstation.evaluation.report import write_report
from groundstation.evaluation.run_description import RunDescription
from groundstation.messages import DgpsFix, InitialState, ReferenceFix
from groundstation.replay.recording_replay import (
    apply_filter_resets,
    load_replay_config,
    recorder_for,
    recording_notes,
    without_reference_fixes,
)
from groundstation.replay.reference_prior import ReferencePrior, reference_prior
from groundstation.replay.run_pipeline import RunOutcome, run_pipeline
from groundstation.session import Session, load_dgps, load_session, load_truth
from groundstation.sinks.output_comparison import OutputComparison, OutputComparisonSink
from groundstation.sinks.sink import Sink
from groundstation.sinks.smoothed_track import SmoothedTrackSink
from groundstation.sinks.track_files import TrackFilesSink
from groundstation.sources.reference_fixes import reference_fixes, with_reference
from groundstation.sources.session_source import session_source
from groundstation.thread_scheduling import short_gil_switch_interval
from groundstation.tracking.config import Config, TrackStart, config_to_mapping
from groundstation.tracking.count_descriptions import describe_counts
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.warm_up import warm_up
from groundstation.viewer.session_view import reference_tracks, session_view

# standard deviation of an unknown DGPS clock offset, for the initial position of a start from DGPS
_DGPS_CLOCK_SIGMA_S = 0.5
_DGPS_START_SPAN_S = 1.0
_MIN_BASELINE_M = 0.1
_CLOCKS_APART_S = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayRequest:
    """Arguments of a replay; ``rig`` and ``config`` None select the session's rig and tuning (or the defaults).

    Up to ``learn_until_s`` of its clock the DGPS updates the filter and its calibration states; None uses it for
    comparison only. ``smooth`` also writes the smoothed track. ``record`` is the path of a recording to write.
    ``report`` False leaves out report.html, whose figures take longer than a short replay.
    """

    session: Path
    out: Path
    rig: Path | None = None
    config: Path | None = None
    from_s: float | None = None
    to_s: float | None = None
    learn_until_s: float | None = None
    rerun: bool = True
    smooth: bool = False
    record: Path | None = None
    report: bool = True

    @property
    def unmodified(self) -> bool:
        """Whether a recording is replayed with its own rig, tuning and time span."""
        return all(v is None for v in (self.rig, self.config, self.from_s, self.to_s, self.learn_until_s))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplayResult:
    """Result of a replay: the evaluation, the files written, and the fault that ended the run early, if any.

    ``output_comparison`` compares the outputs with the recorded ones, for a recording replayed unmodified; else None.
    """

    evaluation: Evaluation
    files: tuple[Path, ...]
    fault: InputError | None
    output_comparison: OutputComparison | None = None


def replay(request: ReplayRequest, progress: Callable[[int, int], None] = lambda done, total: None) -> ReplayResult:
    """Replay one session; ``progress`` is called with the number of epochs done and the total.

    Raises `InputError` if the session cannot be loaded. A fault during the run is in the result.
    """
    began = time.perf_counter()
    session = _usable_session(request)
    config = load_replay_config(session, request.config)
    # a damaged reference table does not stop the run
    broken: list[SessionError] = []
    notes: list[str] = []
    dgps = load_dgps(session, broken.append, notes.append)
    faults = [f"{fault}; rows of DGPS before that: {len(dgps)}" for fault in broken] + notes
    broken.clear()
    truth = load_truth(session, broken.append)
    faults += [f"{fault}; rows of truth before that: {0 if truth is None else len(truth.t_s)}" for fault in broken]
    faults += _clock_notes(session)
    prior = reference_prior(session, config.estimation)
    faults += prior.notes
    with ExitStack() as opened:
        opened.enter_context(short_gil_switch_interval())
        check = OutputComparisonSink() if session.recorded is not None and request.unmodified else None
        on_recorded_output = check.recorded if check is not None else lambda line: None
        source = session_source(session, request.from_s, request.to_s, on_recorded_output)
        opened.enter_context(source)
        fixes = _learning_fixes(request, session, dgps, prior)
        header = session.recorded.header if session.recorded is not None else None
        learnt = header is not None and header.learns_from_reference
        learns = bool(fixes) or (learnt and request.learn_until_s is None)
        initial = _initial(request, config, session, dgps, source.span_s[0])
        _make_folder(request.out)
        warm_up()
        collector = ResultCollector()
        files = opened.enter_context(TrackFilesSink(request.out))
        view = session_view(request.out / "session.rrd", session) if request.rerun else None
        smoothed = SmoothedTrackSink() if request.smooth else None
        recorder = None
        if request.record is not None:
            recorder = recorder_for(request.record, session, request.rig, config, initial, learns)
            opened.enter_context(recorder)
        optional = (recorder, view, smoothed, check)
        sinks: list[Sink] = [collector, files, *(sink for sink in optional if sink is not None)]
        pipeline = Pipeline(
            session.rig,
            config,
            span_m=session.target.span_m,
            initial=initial,
            stopwatch=time.perf_counter,
            reference_errors=prior.errors if learns else None,
            keep_images=view is not None and view.wants_pictures,
        )
        if smoothed is not None:
            smoothed.want = pipeline.smooth(smoothed.found)
        prepared_s = time.perf_counter() - began
        total, span_s = source.epoch_count, source.span_s[1] - source.span_s[0]
        recorded_events = apply_filter_resets(source) if session.recorded is not None else source
        events = with_reference(without_reference_fixes(recorded_events) if fixes else recorded_events, fixes)
        if recorder is not None:
            events = recorder.taken(events)
        outcome = run_pipeline(events, pipeline, sinks, lambda done: progress(done, total))
    pipeline.finish_smoothing()
    if outcome.fault is not None:
        faults.append(str(outcome.fault))
    faults += recording_notes(source, recorder)
    faults += describe_counts(pipeline.counts)
    if fixes and pipeline.reference_used_until_s is None:
        faults.append("nothing was learnt from DGPS: no target was held while it was there, or nothing may be learnt")
    description = RunDescription(
        name=session.name,
        phases=session.phases,
        antenna_in_body_m=prior.antenna_in_body_m,
        clocks_given=session.has_clocks,
        acceleration_psd_m2_s3=config.estimation.acceleration_psd_m2_s3,
        configuration=config_to_mapping(config),
        speed=_speed(outcome, span_s, prepared_s),
        faults=tuple(faults),
        carried_errors=pipeline.carried_errors,
        learnt_until_s=_dgps_time(pipeline.reference_used_until_s, prior),
        fused_late=pipeline.fused_late,
    )
    if pipeline.reference_used_until_s is not None:
        # fixes that updated the filter are no independent reference
        until_s = pipeline.reference_used_until_s + prior.offset_s
        dgps = tuple(fix for fix in dgps if fix.t_s > until_s)
    smoothed_track = None if smoothed is None else smoothed.collected()
    evaluation = evaluate_run(
        collector,
        description,
        rig=session.rig,
        config=config.evaluation,
        dgps=dgps,
        truth=truth,
        smoothed=smoothed_track,
    )
    # frees the fixes (one object each) before the figures are drawn
    del dgps
    written = ["track.csv", "triangulation.csv", "detections.csv", "track.tum"]
    if smoothed is not None:
        smoothed.save(request.out / "smoothed.csv")
        written.append("smoothed.csv")
    if view is not None:
        view.write_reference(reference_tracks(evaluation, smoothed_track))
        view.close()
        written.append("session.rrd")
    write_summary(request.out / "summary.json", evaluation)
    written += [path.name for path in write_reference_tums(request.out, evaluation)]
    written += ["summary.json"]
    if request.report:
        written += [path.name for path in write_report(request.out / "report.html", evaluation, config.evaluation)]
    paths = [request.out / name for name in written] + ([] if request.record is None else [request.record])
    output_comparison = None if check is None else check.result()
    return ReplayResult(
        evaluation=evaluation, files=tuple(paths), fault=outcome.fault, output_comparison=output_comparison
    )


def _learning_fixes(
    request: ReplayRequest, session: Session, dgps: Sequence[DgpsFix], prior: ReferencePrior
) -> list[ReferenceFix]:
    """Return the DGPS positions that the filter may learn from; none unless asked for."""
    if request.learn_until_s is None:
        return []
    fixes = reference_fixes(dgps, prior.antenna_in_body_m, request.learn_until_s, prior.offset_s)
    if not fixes:
        got = f"no DGPS fix up to {request.learn_until_s:g} s" if dgps else "no DGPS at all"
        raise SessionError(session.name, got=got, wanted="some, for --learn-until")
    return fixes


def _usable_session(request: ReplayRequest) -> Session:
    """Load the session; raises if it cannot be tracked or if the output would overwrite it."""
    session = load_session(request.session, request.rig)
    if len(session.rig.stations) < 2:
        raise RigError(session.rig.path, got="one station", wanted="two or more: one alone sees no distance")
    session.rig.require_known()
    places = np.array([s.ptu_position_m for s in session.rig.stations])
    if float(np.ptp(places, axis=0).max()) < _MIN_BASELINE_M:
        raise RigError(session.rig.path, got="all stations in one place", wanted="stations that stand apart")
    if request.out.resolve() == request.session.resolve():
        got = "the session folder itself"
        raise InputError(str(request.out), got=got, wanted="another folder: results would replace recordings")
    return session


def _dgps_time(t_s: float | None, prior: ReferencePrior) -> float | None:
    return None if t_s is None else t_s + prior.offset_s


def _clock_notes(session: Session) -> list[str]:
    """Return a note for each station whose camera and PTU clock offsets differ implausibly."""
    notes = []
    for station in session.rig.stations:
        camera = station.camera_clock.offset_s if station.camera_clock is not None else 0.0
        if not station.fixed and session.has_clocks and abs(camera - station.ptu_clock.offset_s) > _CLOCKS_APART_S:
            notes.append(
                f"station {station.name}: [clocks] moves its camera by {camera:g} s, and its PTU is moved by "
                f"{station.ptu_clock.offset_s:g} s (ptu_clock in the rig): is that meant?"
            )
    return notes


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(str(folder), got=str(error.strerror), wanted="a folder that can be written") from error


def _speed(outcome: RunOutcome, span_s: float, prepared_s: float) -> dict[str, float]:
    """Return the processing speed; preparation covers imports, compilation and opening of the inputs."""
    elapsed = max(outcome.elapsed_s, 1e-9)
    return {
        "preparation_s": prepared_s,
        "replay_s": outcome.elapsed_s,
        "epochs_per_s": outcome.epochs / elapsed,
        "times_real_time": span_s / elapsed,
    }


def _initial(
    request: ReplayRequest, config: Config, session: Session, dgps: Sequence[DgpsFix], first_s: float
) -> InitialState | None:
    """Return the recorded initial state; with another tuning or start time, the one that the tuning selects."""
    if session.recorded is not None and request.config is None and request.from_s is None:
        return session.recorded.header.initial
    return _start(config.start, session, dgps, first_s)


def _start(kind: TrackStart, session: Session, dgps: Sequence[DgpsFix], first_s: float) -> InitialState | None:
    """Return the initial state, or None to start with a search."""
    if kind is TrackStart.SEARCH or (kind is TrackStart.AUTO and session.initial is None):
        return None
    if kind in (TrackStart.AUTO, TrackStart.INITIAL):
        if session.initial is None:
            raise SessionError(f"{session.name}: session.toml", got="no [initial]", wanted="one, for start = 'initial'")
        return session.initial
    return start_from_dgps(dgps, first_s, session.name)


def start_from_dgps(dgps: Sequence[DgpsFix], first_s: float, name: str) -> InitialState:
    """Return position and velocity from a line fit to the first second of DGPS fixes in the range.

    The unknown offset between the two clocks is included in sigma along the direction of flight.
    """
    near = [f for f in dgps if first_s <= f.t_s <= first_s + _DGPS_START_SPAN_S]
    if len(near) < 2:
        raise SessionError(
            f"{name}: dgps.csv", got=f"{len(near)} fixes in the first second", wanted="2 or more, for start = 'dgps'"
        )
    t = np.array([f.t_s for f in near])
    points = np.array([f.position_runway_m for f in near])
    velocity, at_start = np.polyfit(t - t[0], points, 1)
    return InitialState(
        t_s=float(t[0]),
        position_runway_m=np.asarray(at_start, dtype=np.float64),
        velocity_runway_m_s=np.asarray(velocity, dtype=np.float64),
        sigma_position_m=1.0 + _DGPS_CLOCK_SIGMA_S * np.abs(velocity),
        sigma_velocity_m_s=np.full(3, 2.0),
    )
