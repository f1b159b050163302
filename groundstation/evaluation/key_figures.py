"""Key figures of a run: named numbers from its summary, and their changes between two runs."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

AXES = ("x", "y", "z")
_METHODS = ("ekf", "triangulation")
_PERCENTILES = ("p50", "p90", "p99", "max")


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureChange:
    """A figure in two runs; None where one of them does not have it."""

    before: float | None
    after: float | None

    @property
    def percent(self) -> float | None:
        """Return by how much it has grown, %; None where that is not a number."""
        if self.before is None or self.after is None or self.before == 0.0:
            return None
        return 100.0 * (self.after - self.before) / abs(self.before)

    def within(self, relative: float, absolute: float) -> bool:
        """Return whether it has stayed, by a share of what it was or by an absolute amount."""
        if self.before is None or self.after is None:
            return self.before is self.after
        return abs(self.after - self.before) <= max(relative * abs(self.before), absolute)


def figures_of(summary: Mapping[str, Any]) -> dict[str, float]:
    """Return the figures of a summary.json by name, such as ``truth.y250-400.ekf.rmse_y_m``, without what is null."""
    found = dict(_all_figures(summary))
    return {name: float(value) for name, value in found.items() if value is not None}


def moved_figures(before: Mapping[str, float], after: Mapping[str, float]) -> dict[str, FigureChange]:
    """Return every figure of either run, in the order of the first."""
    return {name: FigureChange(before=before.get(name), after=after.get(name)) for name in {**before, **after}}


def group_names(table: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Return the groups of one reference's accuracy with their names: all, ranges, backgrounds."""
    yield "all", table["total"]
    for group in table["by_range"]:
        upper = "" if group["to_m"] is None else f"{group['to_m']:g}"
        yield f"y{group['from_m']:g}-{upper}", group
    yield from table["by_phase"].items()


def _all_figures(summary: Mapping[str, Any]) -> Iterator[tuple[str, float | None]]:
    for reference, table in summary["accuracy"].items():
        for name, group in group_names(table):
            yield from _group(f"{reference}.{name}", group)
    for who, nis in summary["nis"].items():
        yield f"nis.{who}.mean", nis["mean"]
        yield f"nis.{who}.rejected", nis["rejected"]
    offset = summary["reference"]["time_offset"]
    if offset is not None:
        yield "dgps_clock.offset_s", offset["offset_s"]
    for p in _PERCENTILES:
        yield f"latency.{p}_ms", summary["latency_ms"][p]
    for word, count in summary["counts"]["track"].items():
        yield f"pairs.{word}", count
    for station, counts in summary["counts"]["detection"].items():
        for word, count in counts["status"].items():
            yield f"detections.{station}.{word}", count
        for word, count in counts["miss_reason"].items():
            yield f"misses.{station}.{word.replace(' ', '_')}", count


def _group(name: str, group: Mapping[str, Any]) -> Iterator[tuple[str, float | None]]:
    yield f"{name}.pairs", group["reference_epochs"]
    for method in _METHODS:
        of = group[method]
        yield f"{name}.{method}.coverage", of["coverage"]
        for axis, value in zip(AXES, of["rmse_m"] or (None,) * 3, strict=True):
            yield f"{name}.{method}.rmse_{axis}_m", value
        # on the epochs that both methods have
        for axis, value in zip(AXES, group["common"][f"{method}_rmse_m"] or (None,) * 3, strict=True):
            yield f"{name}.common.{method}.rmse_{axis}_m", value
    yield f"{name}.ekf.anees", group["anees"]
