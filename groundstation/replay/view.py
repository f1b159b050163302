"""Display of one run or several on one runway, in the viewer, in a browser, or saved to a file."""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from groundstation.errors import InputError, RigError, SessionError, os_words
from groundstation.files.output_names import below
from groundstation.files.overwriting import Output
from groundstation.replay.run_planning import (
    RECORDING,
    PlannedRun,
    SourceKind,
    plan_runs,
    refuse_replay_overwriting,
    run_results,
)
from groundstation.session import load_session
from groundstation.viewer.comparison_recording import (
    ComparedRun,
    event_at,
    event_text,
    overlap_in_time,
    read_runs,
    write_comparison,
)
from groundstation.viewer.merge_recordings import RunAlignment
from groundstation.viewer.recording_check import check_recording
from groundstation.viewer.results_recording import write_results_recording
from groundstation.viewer.session_recording import write_session_recording

_VIEW = "view.rrd"


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewRequest:
    """Arguments of a view; ``align`` None aligns the runs' starts only if they do not overlap in time.

    ``work`` is the folder for replays and for the recording that is shown; ``save`` is another path for the latter.
    """

    sources: tuple[Path, ...]
    work: Path
    configs: tuple[Path, ...] = ()
    rig: Path | None = None
    align: RunAlignment | None = None
    save: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewResult:
    """The recording to open, the names of the runs in it, their alignment, and notes for the user.

    ``event_s`` is the common time of the runs' ``event``, the start, the touchdown or a substitute for it;
    None without alignment.
    """

    recording: Path
    names: tuple[str, ...]
    align: RunAlignment
    notes: tuple[str, ...]
    event_s: float | None = None
    event: str = ""


def prepare_view(
    request: ViewRequest, progress: Callable[[str, int, int], None] = lambda name, done, total: None
) -> ViewResult:
    """Replay the sessions among the sources and write one recording of all runs.

    Raises `InputError` for a path that is no run or that cannot be combined with others.
    """
    runs = plan_runs(request.sources, request.configs)
    saved = Output(path=request.work / _VIEW) if request.save is None else Output(path=request.save, option="--save")
    tables = [Output(path=below(request.work, f"{run.name}.rrd")) for run in runs]
    refuse_replay_overwriting((*request.sources, *request.configs, request.rig), runs, request.work, (saved, *tables))
    if request.rig is not None and not any(run.kind is SourceKind.SESSION for run in runs):
        raise InputError(str(request.rig), got="nothing that is replayed", wanted="a session, for --rig")
    notes: list[str] = []
    recordings: dict[str, Path] = {}
    for run in runs:
        recordings[run.name] = _recording(run, request, progress, notes)
    made = {name for name, path in recordings.items() if path == below(request.work, f"{name}.rrd")}
    unplayed = {run.name for run in runs if run.name in made and run.kind is SourceKind.SESSION}
    for name, path in recordings.items():
        if name not in made:
            check_recording(path)
    # a recording made from tables has no blueprint
    if len(recordings) == 1 and request.align in (None, RunAlignment.NONE) and runs[0].name not in made:
        path = next(iter(recordings.values()))
        return ViewResult(
            recording=_kept(path, request.save), names=tuple(recordings), align=RunAlignment.NONE, notes=tuple(notes)
        )
    shown = read_runs(recordings, request.align or RunAlignment.NONE)
    align = request.align or RunAlignment.NONE
    if request.align is None and not overlap_in_time(shown):
        align = RunAlignment.START
        notes.append("the runs have no time in common: shown from each one's start (--align none keeps their times)")
        shown = read_runs(recordings, align)
    notes += _missing([run for run in shown if run.name not in unplayed], align)
    path = request.save if request.save is not None else request.work / _VIEW
    _make_folder(path.parent)
    write_comparison(path, shown, align)
    return ViewResult(
        recording=path,
        names=tuple(recordings),
        align=align,
        notes=tuple(notes),
        event_s=event_at(shown, align),
        event=event_text(shown, align),
    )


def _recording(
    run: PlannedRun, request: ViewRequest, progress: Callable[[str, int, int], None], notes: list[str]
) -> Path:
    """Return the Rerun recording of a run; without one, replay the session or write it from the tables."""
    if run.kind is SourceKind.RERUN:
        return run.source
    try:
        folder, fault = run_results(
            run,
            request.work,
            rig=request.rig,
            rerun=True,
            smooth=True,
            progress=lambda done, total: progress(run.name, done, total),
        )
    except (RigError, SessionError) as unusable:
        return _unplayed(run, request, unusable, notes)
    if fault is not None:
        notes.append(f"{run.name}: fault in the recording: {fault}")
    if (folder / RECORDING).is_file():
        return folder / RECORDING
    made = below(request.work, f"{run.name}.rrd")
    _make_folder(made.parent)
    write_results_recording(folder, made, run.name)
    notes.append(f"{run.name}: replayed without a Rerun recording; its tables are shown")
    return made


def _unplayed(run: PlannedRun, request: ViewRequest, why: InputError, notes: list[str]) -> Path:
    """Return a recording of the contents of a session that cannot be replayed; raises ``why`` if it has none."""
    made = below(request.work, f"{run.name}.rrd")
    _make_folder(made.parent)
    shown = write_session_recording(load_session(run.source, request.rig), made)
    if not shown:
        raise why
    notes.append(f"{run.name}: not replayed, so {', '.join(shown)} alone: {why}")
    return made


def _missing(shown: Sequence[ComparedRun], align: RunAlignment) -> list[str]:
    """Return notes on runs without a track or a touchdown, and on their alignment."""
    where = "" if align is RunAlignment.NONE else ", put by the first time in it"
    notes = [f"{run.name}: no estimate in it, so no track{where}" for run in shown if not len(run.track)]
    for run in shown:
        if align is RunAlignment.TOUCHDOWN and len(run.track) and not run.track.touches_down:
            lowest_m = float(run.track.position_runway_m[:, 2].min())
            notes.append(
                f"{run.name}: no touchdown in it, the track is never below {lowest_m:.0f} m: put by the time at which "
                "it comes within 0.5 m of that (--align start puts it by its first estimate)"
            )
    return notes


def _kept(path: Path, save: Path | None) -> Path:
    """Copy a recording to ``save``, if given."""
    if save is None:
        return path
    _make_folder(save.parent)
    try:
        shutil.copyfile(path, save)
    except OSError as fault:
        raise InputError(str(save), got=os_words(fault), wanted="a file that can be written") from fault
    return save


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise InputError(str(folder), got=os_words(fault), wanted="a folder that can be written") from fault


def names_line(result: ViewResult, sources: Sequence[Path]) -> str:
    """Return one line that describes the runs shown and their alignment."""
    if len(result.names) == 1:
        return f"showing {sources[0]}"
    how = "each in its own time" if result.event_s is None else f"{result.event} of each at {result.event_s:.0f} s"
    return f"showing {', '.join(result.names)} on one runway, {how}"
