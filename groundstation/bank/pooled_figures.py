"""Figures over all sessions of a bank: pooled shares with their intervals, and distributions over sessions."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.bank.result_table import Row

_RESAMPLES = 2000
_SEED = 20
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
_INTERVAL = (0.025, 0.975)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ratio:
    """A figure that is one sum over sessions divided by another: names of the columns, and a constant divisor."""

    title: str
    above: str
    below: str
    divisor: float = 1.0
    percent: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class PooledFigure:
    """A ratio over all sessions: its value, None where the sum below is 0, with the interval of `ratio_interval`."""

    ratio: Ratio
    value: float | None
    low: float | None
    high: float | None
    sessions: int


HIT = Ratio(title="visible frames hit", above="hit", below="visible_frames")
WRONG = Ratio(title="visible frames with a wrong point", above="wrong_visible", below="visible_frames")
COVERAGE = Ratio(title="epochs with an estimate, from the first track on", above="covered_epochs", below="due_epochs")
MISLEADING = Ratio(title="misleading, of tracking epochs", above="misleading_epochs", below="tracking_epochs")
POOLED = (
    HIT,
    WRONG,
    COVERAGE,
    MISLEADING,
    Ratio(title="hit by initial pixels, of visible frames", above="hit_initial", below="visible_frames"),
    Ratio(title="ANEES while tracking", above="nees_sum", below="nees_count", divisor=3.0, percent=False),
    Ratio(title="NIS per degree of freedom", above="nis_sum", below="nis_dof", percent=False),
    Ratio(title="losses followed by a return", above="returned", below="losses"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """Distribution of a figure: its column and title; `QUANTILES` over the ``count`` sessions that have it."""

    column: str
    title: str
    count: int
    quantiles: tuple[float, ...]


_DISTRIBUTED = (
    ("hit_share", "share of visible frames hit"),
    ("wrong_share", "share of visible frames with a wrong point"),
    ("time_to_track_s", "from first visible in two cameras to tracking, s"),
    ("coverage", "share of epochs with an estimate after that"),
    *((f"near_rmse_{axis}_m", f"RMSE {axis} at y 100–250 m, m") for axis in "xyz"),
    *((f"over_bound_{axis}", f"RMSE over bound, {axis}") for axis in "xyz"),
    ("anees", "ANEES while tracking"),
    ("nis", "NIS per degree of freedom"),
    ("misleading_share", "share of tracking epochs that mislead"),
    ("return_s_max", "longest return after a loss, s"),
    ("excluded_share", "share of frames excluded as not visible"),
    ("baseline_hit_share", "baseline: share of visible frames hit"),
    ("baseline_coverage", "baseline: coverage"),
    *((f"baseline_near_rmse_{axis}_m", f"baseline: RMSE {axis} at y 100–250 m, m") for axis in "xyz"),
    ("baseline_anees", "baseline: ANEES"),
)


def pooled(rows: Sequence[Row], ratio: Ratio) -> PooledFigure:
    """Return a ratio over sessions, with the interval of a bootstrap over sessions (percentiles, seeded)."""
    known = [row for row in rows if row.get(ratio.below)]
    above = np.array([float(row[ratio.above] or 0.0) for row in known])
    below = np.array([float(row[ratio.below]) for row in known]) * ratio.divisor
    value = above.sum() / below.sum() if known else None
    low, high = ratio_interval(above, below) or (None, None)
    return PooledFigure(ratio=ratio, value=value, low=low, high=high, sessions=len(known))


def bootstrap_interval(count: int, figure: Callable[[np.ndarray], float]) -> tuple[float, float]:
    """Return the 95 % interval of a figure of resampled sessions; ``figure`` takes indices (count,) from 0."""
    low, high = np.quantile([figure(indices) for indices in _resampled(count)], _INTERVAL)
    return float(low), float(high)


def ratio_interval(above: FloatArray, below: FloatArray) -> tuple[float, float] | None:
    """Return the 95 % interval of the ratio of two sums (n,) over resampled sessions; None where they do not tell.

    That is a single session, and ratios that are the same in each: what has never happened in some sessions would
    have the interval 0 to 0, in however few.
    """
    if len(above) < 2 or np.all(above * below[0] == above[0] * below):
        return None
    drawn = _resampled(len(above))
    low, high = np.quantile(above[drawn].sum(axis=1) / below[drawn].sum(axis=1), _INTERVAL)
    return float(low), float(high)


def _resampled(count: int) -> NDArray[np.int64]:
    """Return which of so many sessions are drawn (r, count), from 0."""
    return np.random.default_rng(_SEED).integers(0, count, (_RESAMPLES, count))


def session_values(rows: Sequence[Row], column: str) -> FloatArray:
    """Return a column's known values (n,), ascending."""
    found = (row.get(column) for row in rows)
    return np.array(sorted(float(v) for v in found if v is not None and math.isfinite(v)), dtype=np.float64)


def distributions(rows: Sequence[Row]) -> list[Distribution]:
    """Return the distributions of all figures that at least one session has."""
    found = []
    for column, title in _DISTRIBUTED:
        values = session_values(rows, column)
        if len(values):
            quantiles = tuple(np.quantile(values, QUANTILES).tolist())
            found.append(Distribution(column=column, title=title, count=len(values), quantiles=quantiles))
    return found
