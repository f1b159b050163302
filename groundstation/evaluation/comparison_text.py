"""Comparison of several runs as text: accuracy by range, consistency, delay, misses and differing settings."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from groundstation.evaluation.key_figures import AXES, FigureChange, figures_of

REFERENCE_WORDS = {"truth": "the truth", "dgps": "DGPS"}
_MOST_SETTINGS = 12
OWN_PAIRS = """EKF and triangulation (tri.) each on all pairs where it has a position. A replay's own table and report
set the two against each other on the pairs that both have, and give these figures as well."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredRun:
    """One run: its name, where it came from, its summary, and its figures by name."""

    name: str
    source: str
    summary: Mapping[str, Any]
    figures: Mapping[str, float]


def scored(name: str, source: str, summary: Mapping[str, Any]) -> ScoredRun:
    """Return a run with its figures."""
    return ScoredRun(name=name, source=source, summary=summary, figures=figures_of(summary))


def format_comparison(runs: Sequence[ScoredRun], baseline: ScoredRun) -> str:
    """Return the comparison for a terminal, each run against ``baseline``."""
    width = max(len(run.name) for run in runs)
    blocks = [_accuracy(reference, runs, baseline, width) for reference in references_of(runs)]
    if not blocks:
        blocks.append("no reference in any of them: no errors")
    else:
        blocks.append(OWN_PAIRS)
    blocks.append("\n".join(_consistency(runs, width)))
    blocks.append("\n".join(_misses(runs)))
    others = [run for run in runs if run is not baseline]
    settings = [line for run in others for line in _settings(run, baseline)]
    if settings:
        blocks.append("\n".join(["set otherwise:", *settings]))
    return "\n\n".join(block for block in blocks if block)


def references_of(runs: Iterable[ScoredRun]) -> list[str]:
    """Return the names of the references that any run is compared with."""
    return list(dict.fromkeys(name for run in runs for name in run.summary["accuracy"]))


def _accuracy(reference: str, runs: Sequence[ScoredRun], baseline: ScoredRun, width: int) -> str:
    """Return one reference's table: a row for each group and run, and by how much the errors differ."""
    against = REFERENCE_WORDS.get(reference, reference)
    head = f"{'':<12} {'':<{width}} {'pairs':>6} {'seen %':>6} │{'EKF x':>7} {'y':>7} {'z':>7} │"
    head += f"{'± % x':>6} {'y':>5} {'z':>5} │ {'ANEES':>6} │{'tri. x':>7} {'y':>7} {'z':>7}"
    lines = [f"RMSE in m against {against}, differences to {baseline.name}", head, "─" * len(head)]
    for group in groups_of(reference, runs):
        label = group
        for run in runs:
            cells = _row(run, baseline, f"{reference}.{group}")
            if cells is not None:
                lines.append(f"{label:<12} {run.name:<{width}} {cells}")
                label = ""
    return "\n".join(lines)


def groups_of(reference: str, runs: Iterable[ScoredRun]) -> list[str]:
    """Return the groups of epochs that any run has: all, ranges from near to far, backgrounds."""
    names = dict.fromkeys(
        name.split(".")[1] for run in runs for name in run.figures if name.startswith(f"{reference}.")
    )
    ranges = sorted((n for n in names if _from_m(n) is not None), key=lambda n: _from_m(n) or 0.0)
    return ["all", *ranges, *(n for n in names if n != "all" and n not in ranges)]


def _from_m(group: str) -> float | None:
    """Return where a range begins, None for a group that is no range."""
    try:
        return float(group.removeprefix("y").split("-")[0]) if group.startswith("y") else None
    except ValueError:
        return None


def _row(run: ScoredRun, baseline: ScoredRun, group: str) -> str | None:
    """Return one run's cells of one group, None where it has no pair of it."""
    f, b = run.figures, baseline.figures
    if not f.get(f"{group}.pairs"):
        return None
    names = [f"{group}.ekf.rmse_{axis}_m" for axis in AXES]
    errors = " ".join(f"{metres(f.get(n)):>7}" for n in names)
    changes = " ".join(
        f"{'' if run is baseline else percent(FigureChange(before=b.get(n), after=f.get(n))):>5}" for n in names
    )
    fixes = " ".join(f"{metres(f.get(n.replace('.ekf.', '.triangulation.'))):>7}" for n in names)
    anees = f.get(f"{group}.ekf.anees")
    return (
        f"{f[f'{group}.pairs']:>6.0f} {100 * f.get(f'{group}.ekf.coverage', 0.0):>6.1f} │{errors} │ {changes} │ "
        f"{'–' if anees is None else format(anees, '.2f'):>6} │{fixes}"
    )


def _consistency(runs: Sequence[ScoredRun], width: int) -> Iterator[str]:
    """Return NIS, refused pixels, delay and where the track was, a row for each run."""
    track = [w for w in runs[0].summary["counts"]["track"] if any(r.figures.get(f"pairs.{w}") for r in runs)]
    yield (
        f"{'':<{width}} {'NIS':>6} {'refused':>8} │ {'delay ms: median':>16} {'99 %':>7} {'max':>7} │ "
        + " ".join(f"{w:>9}" for w in track)
    )
    for run in runs:
        f = run.figures
        nis = f.get("nis.all.mean")
        delays = [f.get(f"latency.{p}_ms") for p in ("p50", "p99", "max")]
        cells = ["–" if d is None else f"{d:.1f}" for d in delays]
        yield (
            f"{run.name:<{width}} {'–' if nis is None else format(nis, '.2f'):>6} {f['nis.all.rejected']:>8.0f} │ "
            f"{cells[0]:>16} {cells[1]:>7} {cells[2]:>7} │ " + " ".join(f"{f[f'pairs.{w}']:>9.0f}" for w in track)
        )


def _misses(runs: Sequence[ScoredRun]) -> Iterator[str]:
    """Return why cameras saw nothing, a line for each run."""
    for run in runs:
        yield f"misses, {run.name}: {misses_of(run)}"


def misses_of(run: ScoredRun) -> str:
    """Return why a run's cameras saw nothing, most frequent first."""
    found = {n.removeprefix("misses."): k for n, k in run.figures.items() if n.startswith("misses.") and k}
    most = sorted(found.items(), key=lambda item: -item[1])
    return ", ".join(f"{name.replace('.', ' ').replace('_', ' ')} {count:.0f}" for name, count in most) or "none"


def _settings(run: ScoredRun, baseline: ScoredRun) -> Iterator[str]:
    """Return the tuning that differs from the baseline's."""
    changed = changed_settings(run, baseline)
    for key, (here, there) in list(changed.items())[:_MOST_SETTINGS]:
        yield f"  {run.name}: {key} = {here} ({baseline.name}: {there})"
    if len(changed) > _MOST_SETTINGS:
        yield f"  {run.name}: and {len(changed) - _MOST_SETTINGS} more"


def changed_settings(run: ScoredRun, baseline: ScoredRun) -> dict[str, tuple[Any, Any]]:
    """Return by its key each setting that differs from the baseline's: the run's, and the baseline's."""
    here, there = (_flat(r.summary["configuration"]) for r in (run, baseline))
    pairs = {key: (here.get(key, "not there"), there.get(key, "not there")) for key in {**there, **here}}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def _flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return nested tables as one, keys joined by dots."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        flat |= _flat(value, f"{before}{key}.") if isinstance(value, Mapping) else {f"{before}{key}": value}
    return flat


def metres(value: float | None) -> str:
    """Return a length in m, or a dash."""
    return "–" if value is None else f"{value:.3f}" if value < 100 else f"{value:.0f}"


def percent(moved: FigureChange) -> str:
    """Return a change in percent, or a dash."""
    change = moved.percent
    return "–" if change is None else f"{change:+.0f}" if abs(change) < 1000 else ">999"
