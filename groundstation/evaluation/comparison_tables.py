"""The tables of a comparison, for its page and as Markdown."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.errors import printable
from groundstation.evaluation.comparison_text import (
    OWN_PAIRS,
    REFERENCE_WORDS,
    ScoredRun,
    changed_settings,
    groups_of,
    metres,
    misses_of,
    percent,
    references_of,
)
from groundstation.evaluation.key_figures import AXES, FigureChange
from groundstation.evaluation.run_series import RunSeries

NOTHING = "–"
_ACCURACY_COLUMNS = (
    *("pairs of", "run", "pairs", "seen, %", "EKF x, m", "EKF y, m", "EKF z, m"),
    *("± % x", "± % y", "± % z", "ANEES", "triang. x, m", "triang. y, m", "triang. z, m"),
)
_DISTANCE_COLUMNS = ("run", "pairs", "RMSE, m", "mean, m", "median, m", "95 %, m", "largest, m")
_SOURCE_COLUMNS = ("run", "session", "pairs", "from, s", "to, s", "replayed", "version", "source")
# columns of words, not of numbers
TEXT_COLUMNS = frozenset(
    {"pairs of", "run", "session", "setting", "value", "the baseline's", "replayed", "version", "source", "misses"}
)
# those that are long
WIDE_COLUMNS = frozenset({"value", "the baseline's", "version", "source", "misses"})
# what a reader of Markdown would take for its marks
_MARKS = re.compile(r"[\\`*\[\]<>|~]|(?<!\w)_|_(?!\w)")
_RANGE = re.compile(r"y(\d[\d.e+]*)-(\d[\d.e+]*)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunsTable:
    """A table of text cells with its title, and a remark below it."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    remark: str = ""


def comparison_tables(
    runs: Sequence[ScoredRun], baseline: ScoredRun, series: Mapping[str, RunSeries]
) -> list[RunsTable]:
    """Return the tables for which the runs have figures; ``series`` has the tracks that could be read, by run."""
    tables = []
    for reference in references_of(runs):
        tables.append(_accuracy(reference, runs, baseline))
        distances = [row for run in runs if (row := _distances(series.get(run.name), reference)) is not None]
        if distances:
            words = printable(REFERENCE_WORDS.get(reference, reference))
            title = f"Size of the EKF's error against {words}, in 3-D"
            tables.append(RunsTable(title=title, columns=_DISTANCE_COLUMNS, rows=distances))
    return [*tables, _consistency(runs), *_settings(runs, baseline), _sources(runs)]


def markdown(tables: Iterable[RunsTable], notes: Sequence[str]) -> str:
    """Return tables and notes as Markdown (pipe tables, as GitHub and others render them)."""
    blocks = []
    for table in tables:
        lines = [f"### {_escaped(table.title)}", "", _row(table.columns)]
        lines.append("|" + "".join(" :-- |" if column in TEXT_COLUMNS else " --: |" for column in table.columns))
        lines += [_row(row) for row in table.rows]
        if table.remark:
            lines += ["", _escaped(table.remark)]
        blocks.append("\n".join(lines))
    if notes:
        blocks.append("\n".join(["### Notes", "", *(f"- {_escaped(note)}" for note in notes)]))
    return "\n\n".join(blocks) + "\n"


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(_escaped(cell) for cell in cells) + " |"


def _escaped(text: str) -> str:
    return _MARKS.sub(r"\\\g<0>", printable(" ".join(text.split())))


def _accuracy(reference: str, runs: Sequence[ScoredRun], baseline: ScoredRun) -> RunsTable:
    """Return one reference's accuracy: for each group of pairs a row for each run."""
    rows = []
    for group in groups_of(reference, runs):
        for run in runs:
            row = _accuracy_row(run, baseline, f"{reference}.{group}")
            if row is not None:
                rows.append([_group_words(group), run.name, *row])
    words = printable(REFERENCE_WORDS.get(reference, reference))
    return RunsTable(
        title=f"RMSE against {words}, differences to {baseline.name}",
        columns=_ACCURACY_COLUMNS,
        rows=rows,
        remark=f"{OWN_PAIRS} ANEES: the mean squared error in units of the stated covariance; 1 is ideal.",
    )


def _group_words(group: str) -> str:
    """Return the name of a group of pairs in words: a range of y, or a background."""
    found = _RANGE.fullmatch(group)
    if found is None:
        return group
    return f"y {found[1]}–{found[2]} m" if found[2] else f"y {found[1]} m and more"


def _accuracy_row(run: ScoredRun, baseline: ScoredRun, group: str) -> list[str] | None:
    """Return one run's cells of one group; None where it has no pair of it."""
    f, b = run.figures, baseline.figures
    if not f.get(f"{group}.pairs"):
        return None
    names = [f"{group}.ekf.rmse_{axis}_m" for axis in AXES]
    anees = f.get(f"{group}.ekf.anees")
    return [
        f"{f[f'{group}.pairs']:.0f}",
        f"{100 * f.get(f'{group}.ekf.coverage', 0.0):.1f}",
        *(metres(f.get(n)) for n in names),
        *("" if run is baseline else percent(FigureChange(before=b.get(n), after=f.get(n))) for n in names),
        NOTHING if anees is None else f"{anees:.2f}",
        *(metres(f.get(n.replace(".ekf.", ".triangulation."))) for n in names),
    ]


def _distances(run: RunSeries | None, reference: str) -> list[str] | None:
    """Return one run's statistics of the error's size; None without errors."""
    errors = None if run is None else run.errors(reference)
    if run is None or errors is None:
        return None
    size = errors.distance_m[errors.known]
    values = (np.sqrt((size**2).mean()), size.mean(), np.median(size), np.percentile(size, 95), size.max())
    return [run.name, str(len(size)), *(metres(float(value)) for value in values)]


def _consistency(runs: Sequence[ScoredRun]) -> RunsTable:
    """Return NIS, refused pixels, delay, where the track was and what was missed, a row for each run."""
    words = [w for w in runs[0].summary["counts"]["track"] if any(r.figures.get(f"pairs.{w}") for r in runs)]
    rows = []
    for run in runs:
        f = run.figures
        nis = f.get("nis.all.mean")
        delays = [f.get(f"latency.{p}_ms") for p in ("p50", "p99", "max")]
        rows.append(
            [
                run.name,
                NOTHING if nis is None else f"{nis:.2f}",
                f"{f['nis.all.rejected']:.0f}",
                *(NOTHING if d is None else f"{d:.1f}" for d in delays),
                *(f"{f[f'pairs.{w}']:.0f}" for w in words),
                misses_of(run),
            ]
        )
    return RunsTable(
        title="Consistency, delay, status of the pairs, and misses",
        columns=("run", "NIS", "refused", "delay median, ms", "99 %, ms", "largest, ms", *words, "misses"),
        rows=rows,
        remark="NIS: the mean squared innovation of accepted pixels, in units of what the filter expects; 1 is ideal.",
    )


def _settings(runs: Sequence[ScoredRun], baseline: ScoredRun) -> list[RunsTable]:
    """Return the tuning that differs from the baseline's; no table where none does."""
    rows = [
        [run.name, key, str(here), str(there)]
        for run in runs
        if run is not baseline
        for key, (here, there) in changed_settings(run, baseline).items()
    ]
    columns = ("run", "setting", "value", "the baseline's")
    return [RunsTable(title=f"Set otherwise than in {baseline.name}", columns=columns, rows=rows)] if rows else []


def _sources(runs: Sequence[ScoredRun]) -> RunsTable:
    """Return where each run comes from."""
    rows = []
    for run in runs:
        session = run.summary["session"]
        known = run.summary.get("provenance")
        origin = known if isinstance(known, Mapping) else {}
        version = " ".join(str(origin[key]) for key in ("version", "commit") if origin.get(key))
        times = [session.get(key) for key in ("from_s", "to_s")]
        rows.append(
            [
                run.name,
                str(session["name"]),
                str(session["epochs"]),
                *(f"{t:.2f}" if isinstance(t, int | float) else NOTHING for t in times),
                str(origin.get("date") or NOTHING),
                version or NOTHING,
                run.source,
            ]
        )
    return RunsTable(title="The runs", columns=_SOURCE_COLUMNS, rows=rows)
