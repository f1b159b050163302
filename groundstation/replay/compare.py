"""Comparison of several runs: replay the sessions, read the figures, compare each run with a baseline."""

import csv
import io
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from groundstation.errors import InputError, os_words
from groundstation.evaluation.comparison_text import ScoredRun, format_comparison, scored
from groundstation.evaluation.key_figures import moved_figures
from groundstation.evaluation.summary import SUMMARY_FORMAT
from groundstation.files.new_folder import make_folder, removed_if_empty
from groundstation.files.overwriting import Output
from groundstation.files.toml_table import quoted, shown
from groundstation.files.whole_file import write_text_whole
from groundstation.replay.run_planning import (
    SUMMARY,
    PlannedRun,
    SourceKind,
    plan_runs,
    refuse_replay_overwriting,
    run_results,
)

COMPARISON_FORMAT = "groundstation-comparison/1"
PAGE, TABLE, CSV, JSON = "comparison.html", "table.md", "comparison.csv", "comparison.json"
PLOTS, MAPS = "plots", "tracks"
# what a comparison writes into its own folder, next to the folders of the runs
COMPARISON_FILES = (PAGE, TABLE, CSV, JSON, f"{MAPS}.kml", f"{MAPS}.geojson")
# tolerances for equal sets of pairs: number, first and last time in s
_ALIKE = (0.0, 0.02, 0.02)
_COLUMNS = ("run", "figure", "value", "baseline", "difference", "percent")


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareRequest:
    """Arguments of a comparison; sessions are replayed into ``work``, with each of ``configs``.

    ``baseline`` is the name of a run or a folder of results; None selects the first run. With ``keep`` the comparison's
    own files (`COMPARISON_FILES`) are to be written into ``work``, too, which is made.
    """

    sources: tuple[Path, ...]
    work: Path
    configs: tuple[Path, ...] = ()
    rig: Path | None = None
    baseline: str | None = None
    keep: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class CompareResult:
    """The runs, the baseline among them, notes for the user, and by run the folder of its results."""

    runs: tuple[ScoredRun, ...]
    baseline: ScoredRun
    notes: tuple[str, ...]
    folders: Mapping[str, Path]

    @property
    def same_pairs(self) -> bool:
        """Whether all runs have the pairs of the baseline."""
        return not any(True for run in self.runs for _ in _other_part(run, self.baseline))


def compare(
    request: CompareRequest, progress: Callable[[str, int, int], None] = lambda name, done, total: None
) -> CompareResult:
    """Evaluate every run; raises `InputError` for a path that is no run or an unfinished one."""
    runs = plan_runs(request.sources, request.configs)
    _refuse_overwriting(request, runs)
    with removed_if_empty(request.work):
        return _compare(request, runs, progress)


def _compare(
    request: CompareRequest, runs: Sequence[PlannedRun], progress: Callable[[str, int, int], None]
) -> CompareResult:
    """Evaluate the runs."""
    if request.rig is not None and not any(run.kind is SourceKind.SESSION for run in runs):
        raise InputError(str(request.rig), got="nothing that is replayed", wanted="a session, for --rig")
    before = None
    if request.baseline is not None and request.baseline not in {run.name for run in runs}:
        names = ", ".join(run.name for run in runs)
        if not Path(request.baseline).exists():
            raise InputError(
                request.baseline,
                got="no such run or folder",
                wanted=f"{names if len(runs) == 1 else f'one of {names}'}, or a folder",
            )
        # a results folder that is not among the runs is inserted before them
        before = Path(request.baseline)
    notes: list[str] = []
    folders: dict[str, Path] = {}
    if request.keep:
        make_folder(request.work)
    found = [_scored(run, request, progress, notes, folders) for run in runs]
    if before is not None:
        (first,) = plan_runs([before])
        name = first.name if first.name not in {run.name for run in runs} else "baseline"
        known = PlannedRun(name=name, source=first.source, kind=first.kind)
        found.insert(0, _scored(known, request, progress, notes, folders))
    wanted = request.baseline if before is None else found[0].name
    baseline = next((run for run in found if run.name == wanted), found[0])
    notes += [note for run in found if run is not baseline for note in _other_part(run, baseline)]
    return CompareResult(runs=tuple(found), baseline=baseline, notes=tuple(notes), folders=folders)


def _refuse_overwriting(request: CompareRequest, runs: Sequence[PlannedRun]) -> None:
    """Raise `InputError` if a replay or a file of the comparison would overwrite an input."""
    read = [*request.sources, *request.configs, request.rig]
    written = []
    if request.keep:
        read += [] if request.baseline is None else [Path(request.baseline)]
        written = [Output(path=request.work, names=COMPARISON_FILES), Output(path=request.work / PLOTS, names=("*",))]
    refuse_replay_overwriting(read, runs, request.work, written)


def _other_part(run: ScoredRun, baseline: ScoredRun) -> Iterator[str]:
    """Yield a note if a run's pairs differ from the baseline's, which alone changes its errors."""
    if any(abs(a - b) > most for a, b, most in zip(_part(run), _part(baseline), _ALIKE, strict=True)):
        yield (
            f"{run.name} has {_part_in_words(run)}, {baseline.name} {_part_in_words(baseline)}: not the same pairs, so "
            "compare ranges rather than all (of one session, `replay --from` and `--to` make the parts alike)"
        )


def _part(run: ScoredRun) -> tuple[float, float, float]:
    """Return how many pairs a run has, and the first and last of their times in s."""
    session = run.summary["session"]
    if session["epochs"] == 0:
        return 0.0, 0.0, 0.0
    return float(session["epochs"]), float(session["from_s"]), float(session["to_s"])


def _part_in_words(run: ScoredRun) -> str:
    pairs, from_s, to_s = _part(run)
    if not pairs:
        return "no pairs"
    return f"{pairs:.0f} pairs from {from_s:g} to {to_s:g} s"


def _scored(
    run: PlannedRun,
    request: CompareRequest,
    progress: Callable[[str, int, int], None],
    notes: list[str],
    folders: dict[str, Path],
) -> ScoredRun:
    """Return one run with its figures, replaying it if it is a session; adds its folder to ``folders``."""
    folder, fault = run_results(
        run,
        request.work,
        rig=request.rig,
        rerun=False,
        progress=lambda done, total: progress(run.name, done, total),
    )
    if fault is not None:
        notes.append(f"{run.name}: fault in the recording: {fault}")
    folders[run.name] = folder
    return _with_figures(run, folder / SUMMARY)


def _with_figures(run: PlannedRun, path: Path) -> ScoredRun:
    """Return a run with the figures of its summary; raises `InputError` if some are missing or not finite."""
    summary = load_summary(path)
    wanted = "a summary.json as `groundstation replay` wrote it"
    try:
        found = scored(run.name, str(run.source), summary)
        # raises if a field that the tables need is missing
        format_comparison((found,), found)
        _part(found)
        parts = (summary["session"]["name"], summary["configuration"].items(), summary["versions"].items())
    except (KeyError, TypeError, AttributeError, ValueError, ArithmeticError) as fault:
        raise InputError(str(path), got=f"not all of it as it should be: {fault}", wanted=wanted) from fault
    odd = [name for name, value in found.figures.items() if not math.isfinite(value)]
    if odd or not isinstance(parts[0], str):
        raise InputError(str(path), got=f"no number for {', '.join(odd[:3]) or 'session.name'}", wanted=wanted)
    return found


def load_summary(path: Path) -> dict[str, Any]:
    """Read a summary.json; raises `InputError` if it is missing or of another format."""
    wanted = "the summary.json of a replay that was finished"
    try:
        summary = json.loads(path.read_text(encoding="utf-8"), parse_float=_finite, parse_constant=_finite)
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted=wanted) from fault
    except (ValueError, RecursionError) as fault:
        raise InputError(str(path), got=f"no JSON ({shown(str(fault))})", wanted=wanted) from fault
    if not isinstance(summary, dict) or summary.get("format") != SUMMARY_FORMAT:
        got = summary.get("format") if isinstance(summary, dict) else type(summary).__name__
        raise InputError(str(path), got=f"format {quoted(got)}", wanted=f"{SUMMARY_FORMAT!r}")
    return summary


def _finite(text: str) -> float:
    """Return a finite number of a file; raises `ValueError` for NaN and infinity."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:20]} is no finite number")
    return value


def comparison_csv(result: CompareResult) -> str:
    """Return the comparison as CSV: one row for each run and figure; a missing value is an empty cell."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(_COLUMNS)
    for run in result.runs:
        for name, moved in moved_figures(result.baseline.figures, run.figures).items():
            both = moved.before is not None and moved.after is not None
            difference = moved.after - moved.before if both else None  # type: ignore[operator]
            values = (moved.after, moved.before, difference, moved.percent)
            table.writerow([run.name, name, *("" if v is None else f"{v:.9g}" for v in values)])
    return text.getvalue()


def comparison_json(result: CompareResult) -> str:
    """Return the comparison as JSON: figures of each run, and each run's differences to the baseline."""
    tables = [
        {
            "name": run.name,
            "source": run.source,
            "session": run.summary["session"]["name"],
            "figures": dict(run.figures),
            "difference": _differences(run, result.baseline),
            "configuration": run.summary["configuration"],
            "versions": run.summary["versions"],
        }
        for run in result.runs
    ]
    whole = {"format": COMPARISON_FORMAT, "baseline": result.baseline.name, "runs": tables}
    return json.dumps(whole, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _differences(run: ScoredRun, baseline: ScoredRun) -> dict[str, float]:
    shared = {name: (value, run.figures[name]) for name, value in baseline.figures.items() if name in run.figures}
    return {name: after - before for name, (before, after) in shared.items()}


def check_folders(paths: Sequence[Path]) -> None:
    """Raise `InputError` for a file in a folder that does not exist; none is created."""
    for path in paths:
        if not path.parent.is_dir():
            raise InputError(str(path), got=f"no folder {path.parent}", wanted="a file in a folder that is there")


def write_comparison_files(files: Sequence[tuple[Path, str]]) -> None:
    """Write texts into files, each whole or not at all; raises `InputError` if one cannot be written."""
    for path, text in files:
        write_text_whole(path, text)
