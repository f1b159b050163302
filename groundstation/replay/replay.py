"""Replaying a recorded session: load, track, write the result files, evaluate, report.

A fault in the recording ends the run early; the results up to it are written, and the fault is returned.
"""

import json
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, closing
from typing import Any

from groundstation.detection.detector_callback import for_stations
from groundstation.evaluation.collector import ResultCollector
from groundstation.evaluation.evaluate import Evaluation, evaluate_run
from groundstation.evaluation.run_description import RunDescription
from groundstation.files.folder_lock import locked_folder
from groundstation.files.new_folder import make_folder, removed_if_empty
from groundstation.messages import Event, ReferenceFix
from groundstation.replay.initial_state import initial_state
from groundstation.replay.provenance import provenance
from groundstation.replay.recorded_references import LearningReferences, learning_references
from groundstation.replay.recording_replay import (
    ReplayRecorder,
    apply_filter_resets,
    source_notes,
    without_reference_fixes,
)
from groundstation.replay.reference_prior import ReferencePrior
from groundstation.replay.replay_inputs import (
    ReplayInputs,
    known_positions,
    load_inputs,
    reference_time_notes,
)
from groundstation.replay.replay_outputs import ReplayOutputs
from groundstation.replay.replay_request import ReplayRequest, ReplayResult
from groundstation.replay.run_pipeline import RunOutcome, run_pipeline
from groundstation.session import Session
from groundstation.sinks.geographic_frame import place_of
from groundstation.sinks.output_comparison import OutputComparisonSink
from groundstation.sources.folder_source import FolderSource
from groundstation.sources.panorama_file import read_panoramas
from groundstation.sources.recording_source import RecordingSource
from groundstation.sources.reference_fixes import with_reference
from groundstation.sources.session_source import session_source
from groundstation.thread_scheduling import short_gil_switch_interval
from groundstation.tracking.config import Config, config_to_mapping
from groundstation.tracking.count_descriptions import describe_counts
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.registered_heads import RegisteredHeads
from groundstation.tracking.warm_up import warm_up
from groundstation.viewer.recording_draft import remove_draft

# a run that tracked less of its epochs has not tracked its aircraft
_TRACKED_SHARE = 0.2

__all__ = ["ReplayRequest", "ReplayResult", "replay"]


def replay(request: ReplayRequest, progress: Callable[[int, int], None] = lambda done, total: None) -> ReplayResult:
    """Replay one session; ``progress`` is called with the number of epochs done and the total.

    Raises `InputError` if the session cannot be loaded. A fault during the run is in the result.
    """
    with removed_if_empty(request.out), ExitStack() as unfinished:
        # an interrupt may fall between a draft's creation and what would discard it
        unfinished.callback(remove_draft, request.out / "session.rrd")
        return _replay(request, progress, unfinished)


def _replay(request: ReplayRequest, progress: Callable[[int, int], None], unfinished: ExitStack) -> ReplayResult:
    """Replay one session; ``unfinished`` gets what is to be deleted where the replay does not come to its end."""
    began_s = time.perf_counter()
    inputs = load_inputs(request)
    session, config, heads = inputs.session, inputs.config, _registered_heads(request, inputs.session)
    with ExitStack() as opened:
        opened.enter_context(short_gil_switch_interval())
        unmodified = request.unmodified and not inputs.other_weights
        comparison = OutputComparisonSink() if session.recorded is not None and unmodified else None
        on_recorded_output = comparison.recorded if comparison is not None else lambda line: None
        fixes = learning_references(request, inputs)
        source = session_source(session, request.from_s, request.to_s, on_recorded_output, fixes.in_place)
        opened.enter_context(source)
        learns = fixes.learns
        written = provenance(request, session, json.dumps(config_to_mapping(config), sort_keys=True))
        initial = initial_state(request, inputs, source.span_s[0])
        make_folder(request.out)
        unfinished.enter_context(locked_folder(request.out))
        warm_up(config.detection.detector)
        outputs = ReplayOutputs(request, session, comparison, opened)
        unfinished.callback(outputs.discard)
        if request.record is not None:
            outputs.recorder = ReplayRecorder(request.record, session, request.rig, config, initial, learns, heads)
            opened.enter_context(closing(outputs.recorder))
        pipeline = Pipeline(
            session.rig,
            config,
            span_m=session.target.span_m,
            initial=initial,
            stopwatch=time.perf_counter,
            reference_errors=inputs.prior.errors if learns else None,
            keep_images=outputs.wants_pictures,
            callbacks=for_stations(request.detector, session.rig.names),
            heads=heads,
        )
        if outputs.smoothed is not None:
            outputs.smoothed.want = pipeline.smooth(outputs.smoothed.found)
        prepared_s, span_s = time.perf_counter() - began_s, source.span_s[1] - source.span_s[0]
        outputs.open_approach(session, pipeline, source.span_s[0], opened)
        events = outputs.taken(_events(source, session, fixes.by_time))
        outcome = run_pipeline(events, pipeline, outputs.sinks(), lambda done: progress(done, source.epoch_count))
        outputs.finish_approach()
    pipeline.finish_smoothing()
    notes = _why_unseen(inputs, outputs, source.span_s) + ([] if outcome.fault is None else [str(outcome.fault)])
    notes += _source_notes(source, session, outputs, config) + _pipeline_notes(pipeline, fixes)
    notes += reference_time_notes(request, inputs, source.span_s) + outputs.checks.notes(tracked=_has_tracked(outputs))
    smoothed_track, speed = outputs.smoothed_track(), _speed(outcome, span_s, prepared_s)
    told = _contradictions(source, outputs)
    evaluation = _evaluate(inputs, pipeline, outputs, smoothed_track, notes, speed, written, told)
    # frees the fixes (one object each) before the figures are drawn
    del inputs
    files = outputs.write(evaluation, smoothed_track, config.evaluation)
    return ReplayResult(
        evaluation=evaluation,
        files=files,
        fault=outcome.fault,
        output_comparison=None if comparison is None else comparison.result(),
        given_up=outputs.given_up,
        approach=outputs.approach_summary,
    )


def _events(
    source: FolderSource | RecordingSource, session: Session, fixes: list[ReferenceFix] | None
) -> Iterable[Event]:
    """Return the events of a source, with ``fixes`` for the filter to learn from instead of its own, if given."""
    recorded = apply_filter_resets(source) if session.recorded is not None else source
    return recorded if fixes is None else with_reference(without_reference_fixes(recorded), fixes)


def _registered_heads(request: ReplayRequest, session: Session) -> RegisteredHeads | None:
    """Return what takes angles from the pictures, where a panorama was given, or stars are to tell."""
    if request.panorama is None and request.stars is None:
        return None
    panoramas = {} if request.panorama is None else read_panoramas(request.panorama)
    stars = {} if request.stars is None else request.stars(session)
    return RegisteredHeads(session.rig, panoramas, where=str(request.panorama), stars=stars)


def _has_tracked(outputs: ReplayOutputs) -> bool:
    return outputs.collector.tracked_share >= _TRACKED_SHARE


def _contradictions(source: FolderSource | RecordingSource, outputs: ReplayOutputs) -> tuple[str, ...]:
    """Return what cannot be right in the inputs; the readings' unit of time only if no target was tracked."""
    tracked = _has_tracked(outputs)
    unit = source.unit_fault() if isinstance(source, FolderSource) and not tracked else ""
    return (unit,) if unit else outputs.checks.contradictions(tracked=tracked)


def _why_unseen(inputs: ReplayInputs, outputs: ReplayOutputs, span_s: tuple[float, float]) -> list[str]:
    """Return what the cameras' directions say of a run over ``span_s`` that has tracked nothing."""
    if _has_tracked(outputs):
        return []
    return list(outputs.checks.why_nothing_was_seen(known_positions(inputs, span_s)))


def _source_notes(
    source: FolderSource | RecordingSource, session: Session, outputs: ReplayOutputs, config: Config
) -> list[str]:
    """Return notes on what was missing from the input, and on faults of the recording that was written."""
    unseen = [name for name in session.rig.names if name not in outputs.collector.stations]
    return source_notes(source, outputs.recorder, config.synchronise.max_gap_s, unseen=unseen)


def _pipeline_notes(pipeline: Pipeline, fixes: LearningReferences) -> list[str]:
    """Return notes on rejected data, on head angles, and on reference fixes of which none was used."""
    notes = list(describe_counts(pipeline.counts))
    if fixes.given and pipeline.reference_used_until_s is None:
        notes.append("no DGPS fix updated the filter: no target was tracked at their times, or no state may change")
    return notes + pipeline.heads.notes()


def _evaluate(
    inputs: ReplayInputs,
    pipeline: Pipeline,
    outputs: ReplayOutputs,
    smoothed_track: ResultCollector | None,
    notes: list[str],
    speed: dict[str, float],
    written: dict[str, Any],
    contradictions: tuple[str, ...],
) -> Evaluation:
    """Evaluate a finished run against DGPS and truth; ``notes`` follow those on the inputs."""
    session, config, prior, dgps = inputs.session, inputs.config, inputs.prior, inputs.dgps
    description = RunDescription(
        name=session.name,
        phases=session.phases,
        antenna_in_body_m=prior.antenna_in_body_m,
        clocks_given=session.has_clocks,
        acceleration_psd_m2_s3=config.estimation.acceleration_psd_m2_s3,
        configuration=config_to_mapping(config),
        speed=speed,
        faults=(*inputs.notes, *notes),
        place=place_of(session),
        provenance=written,
        contradictions=contradictions,
        carried_errors=pipeline.carried_errors,
        learnt_until_s=_dgps_time(pipeline.reference_used_until_s, prior),
        fused_late=pipeline.fused_late,
    )
    if pipeline.reference_used_until_s is not None:
        # fixes that updated the filter are no independent reference
        until_s = pipeline.reference_used_until_s + prior.offset_s
        dgps = tuple(fix for fix in dgps if fix.t_s > until_s)
    return evaluate_run(
        outputs.collector,
        description,
        rig=session.rig,
        config=config.evaluation,
        dgps=dgps,
        truth=inputs.truth,
        smoothed=smoothed_track,
    )


def _dgps_time(t_s: float | None, prior: ReferencePrior) -> float | None:
    return None if t_s is None else t_s + prior.offset_s


def _speed(outcome: RunOutcome, span_s: float, prepared_s: float) -> dict[str, float]:
    """Return the processing speed; preparation covers imports, compilation and opening of the inputs."""
    elapsed = max(outcome.elapsed_s, 1e-9)
    return {
        "preparation_s": prepared_s,
        "replay_s": outcome.elapsed_s,
        "epochs_per_s": outcome.epochs / elapsed,
        "times_real_time": span_s / elapsed,
    }
