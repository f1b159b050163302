"""The folder of a comparison: tables, page, pictures and maps, whatever could be computed of the runs."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from groundstation.errors import InputError, os_words
from groundstation.evaluation.comparison_figures import ERROR_PLOTS, TRACK_PLOTS, comparison_pictures, overlap_in_time
from groundstation.evaluation.comparison_page import compared_reference, comparison_verdict, write_comparison_page
from groundstation.evaluation.comparison_panels import run_styles
from groundstation.evaluation.comparison_tables import comparison_tables, markdown
from groundstation.evaluation.comparison_text import REFERENCE_WORDS, ScoredRun
from groundstation.evaluation.run_series import RunSeries
from groundstation.files.output_names import below
from groundstation.replay.compare import (
    CSV,
    JSON,
    MAPS,
    PAGE,
    PLOTS,
    TABLE,
    CompareResult,
    comparison_csv,
    comparison_json,
    write_comparison_files,
)
from groundstation.replay.run_tables import REFERENCES, read_run
from groundstation.sinks.geographic_frame import ORIGIN_KEYS, geographic_frame
from groundstation.sinks.track_maps import ABOVE_ELLIPSOID, MappedRun, write_maps

_NAMES_IN_TITLE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonFolder:
    """What was written: the paths, and notes on what could not be computed, which the page has as well."""

    files: tuple[Path, ...]
    notes: tuple[str, ...]


def write_comparison_folder(folder: Path, result: CompareResult) -> ComparisonFolder:
    """Write the files of a comparison into ``folder``, the tables first; those of an earlier one are removed.

    A run's track or reference that cannot be read is left out of pictures and maps, with a note. Raises `InputError`
    if a file can't be written.
    """
    _remove_earlier(folder)
    notes = list(result.notes)
    series = _read(result, notes)
    notes += [note for run in result.runs for note in _missing(run, series.get(run.name))]
    runs = [series[run.name] for run in result.runs if run.name in series]
    if not overlap_in_time(runs):
        notes.append("the runs have no time in common: the pictures show each from its first estimate on")
    mapped = _mapped(result, series, notes)
    tables = comparison_tables(result.runs, result.baseline, series)
    texts = [
        (below(folder, TABLE), markdown(tables, notes)),
        (below(folder, CSV), comparison_csv(result)),
        (below(folder, JSON), comparison_json(result)),
    ]
    write_comparison_files(texts)
    written = [path for path, _ in texts]
    if mapped:
        written += write_maps(folder / MAPS, mapped, _title(result.runs))
    written += write_comparison_page(
        below(folder, PAGE),
        below(folder, PLOTS),
        _title(result.runs),
        comparison_verdict(result.runs, result.baseline, compared_reference(result.runs), same=result.same_pairs),
        notes,
        tables,
        comparison_pictures(runs, {name: REFERENCE_WORDS[name] for name in REFERENCES}),
    )
    return ComparisonFolder(files=tuple(written), notes=tuple(notes[len(result.notes) :]))


def _title(runs: Iterable[ScoredRun]) -> str:
    names = [run.name for run in runs]
    return ", ".join(names) if len(names) <= _NAMES_IN_TITLE else f"{len(names)} runs"


def _remove_earlier(folder: Path) -> None:
    """Remove maps and pictures of an earlier comparison, which may have had more of them."""
    names = [*TRACK_PLOTS, *(f"{kind}_{reference}" for kind, reference in product(ERROR_PLOTS, REFERENCES))]
    old = [below(folder, f"{MAPS}{ending}") for ending in (".kml", ".geojson")]
    if below(folder, PLOTS).is_dir():
        old += [below(folder / PLOTS, f"{name}{ending}") for name in names for ending in (".svg", ".png")]
    for path in old:
        try:
            path.unlink(missing_ok=True)
        except OSError as fault:
            raise InputError(str(path), got=os_words(fault), wanted="a file that can be replaced") from fault


def _read(result: CompareResult, notes: list[str]) -> dict[str, RunSeries]:
    """Return the tracks by run; one that cannot be read is a note."""
    found = {}
    for run in result.runs:
        try:
            found[run.name] = read_run(result.folders[run.name], run.name, run.summary)
        except InputError as fault:
            notes.append(f"{run.name}: not in the pictures: {fault}")
    return found


def _missing(run: ScoredRun, series: RunSeries | None) -> Iterator[str]:
    """Yield what cannot be computed of a run, and why."""
    reason = run.summary.get("no_track")
    if isinstance(reason, str) and reason:
        yield f"{run.name}: no track: {reason.removeprefix('no track: ')}"
    elif series is not None and not series.track.known.any():
        yield f"{run.name}: no estimate in its track"
    accuracy: Mapping[str, object] = run.summary["accuracy"]
    if not accuracy:
        yield f"{run.name}: no reference that its track can be compared with, so no errors"
    for name in accuracy:
        words = REFERENCE_WORDS.get(name, "another reference")
        if f"{name}.all.ekf.rmse_x_m" not in run.figures:
            yield f"{run.name}: no pair has both an estimate and a usable position of {words}{_why(run, name)}"
        elif series is not None and series.errors(name) is None:
            yield f"{run.name}: errors against {words} are in the tables only: its folder has no {words} at its pairs"


def _why(run: ScoredRun, reference: str) -> str:
    """Return why DGPS is not usable, if the replay has said so."""
    table = run.summary["reference"]
    offset = table.get("time_offset") if isinstance(table, Mapping) else None
    reason = offset.get("reason") if isinstance(offset, Mapping) and reference == "dgps" else None
    return f": {reason}" if isinstance(reason, str) and reason else ""


def _mapped(result: CompareResult, series: Mapping[str, RunSeries], notes: list[str]) -> list[MappedRun]:
    """Return the runs whose frame on Earth is known; a note has the others."""
    mapped, without = [], []
    for run, (colour, _) in zip(result.runs, run_styles(len(result.runs)), strict=True):
        if run.name not in series:
            continue
        frame = geographic_frame(run.summary.get("place"))
        if frame is None:
            without.append(run.name)
        elif series[run.name].track.known.any():
            mapped.append(MappedRun(frame=frame, series=series[run.name], colour=colour.removeprefix("#")))
    if without:
        files = f"{MAPS}.kml and {MAPS}.geojson"
        what = f"not in {files}" if mapped else f"no {files}"
        notes.append(f"{', '.join(without)}: {what}: its place on Earth is unknown; {ORIGIN_KEYS} would state it")
    unplaced = [run.series.name for run in mapped if run.frame.geoid_separation_m is None]
    if unplaced:
        notes.append(f"{MAPS}.kml, {', '.join(unplaced)}: {ABOVE_ELLIPSOID}")
    return mapped
