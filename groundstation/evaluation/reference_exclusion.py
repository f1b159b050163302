"""Spans of a reference to exclude: gaps, frozen fixes, glitches and lag.

The track under test must not decide which reference is right: a filter that follows a bird disagrees with a
perfect reference. So each exclusion needs evidence in the reference itself: fixes that repeat while the
aircraft moves, a jump away and back, a stretch that follows a freeze or a gap and trails in time. Only a large
lag that x and z show as well as y is taken without such a prompt (a calibration error is in y alone).
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.position_series import (
    BoolArray,
    PositionSeries,
    ReferenceSeries,
    interpolate,
    is_gap,
    runs,
)
from groundstation.evaluation.reference_glitches import find_glitch_runs

_SPEED_WINDOW_S = 0.6
_STOPPED_SIGMA = 3.0


class ExclusionReason(StrEnum):
    """Why a stretch of the reference is left out."""

    FROZEN = "frozen"
    LAGGING = "lagging"
    MISSING = "missing"
    GLITCH = "glitch"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcludedSpan:
    """A stretch of the reference that is not compared with, in the session's clock; ``detail`` for a person."""

    from_s: float
    to_s: float
    reason: ExclusionReason
    detail: str

    def shifted(self, by_s: float) -> "ExcludedSpan":
        """Return the span ``by_s`` later."""
        return replace(self, from_s=self.from_s + by_s, to_s=self.to_s + by_s)


def covers(spans: list[ExcludedSpan], t_s: FloatArray) -> BoolArray:
    """Return which times (n,) lie inside any span."""
    inside = np.zeros(len(t_s), dtype=np.bool_)
    for span in spans:
        inside |= (t_s >= span.from_s) & (t_s <= span.to_s)
    return inside


def find_gaps(reference: ReferenceSeries, max_gap_s: float) -> list[ExcludedSpan]:
    """Return the gaps longer than ``max_gap_s``, in the reference's clock; nothing is interpolated there.

    Gaps that follow each other without a usable interval between are one span.
    """
    dt = np.diff(reference.t_s)
    spans = []
    for first, last in runs(is_gap(dt, max_gap_s)):
        longest = float(dt[first : last + 1].max())
        detail = f"no fix for {longest:.2f} s" if first == last else f"fixes up to {longest:.2f} s apart"
        spans.append(
            ExcludedSpan(
                from_s=float(reference.t_s[first]),
                to_s=float(reference.t_s[last + 1]),
                reason=ExclusionReason.MISSING,
                detail=detail,
            )
        )
    return spans


def find_frozen(
    reference: ReferenceSeries, track: PositionSeries | None, offset_s: float, config: EvaluationConfig
) -> list[ExcludedSpan]:
    """Return held stretches, in the reference's clock.

    A run of fixes within the noise of its first one is frozen if the aircraft moved meanwhile: the track moves
    significantly (where ``track`` is given), or the fixes repeat to the last digit right after having moved
    fast enough and the track does not stop. A standing aircraft moves in neither.
    """
    spans = []
    tolerance = np.maximum(config.frozen_tolerance_m, 4.0 * np.median(reference.sigma_m, axis=0))
    at_fix = _track_at(track, reference.t_s - offset_s) if track is not None else _track_nowhere(len(reference))
    start, n = 0, len(reference)
    while start < n - 1:
        end = start
        while end + 1 < n and np.all(np.abs(reference.position_m[end + 1] - reference.position_m[start]) <= tolerance):
            end += 1
        if end > start:
            first = _first_stale(reference, at_fix, start, end, config)
            if first is not None:
                spans.append(_frozen_span(reference, first, end))
        start = max(end, start + 1)
    return spans


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _TrackAtFixes:
    """The track at the fixes' times: position (n, 3), its sigma (n, 3), and where there is one (n,)."""

    position_m: FloatArray
    sigma_m: FloatArray
    known: BoolArray


def _track_at(track: PositionSeries, t_s: FloatArray) -> _TrackAtFixes:
    """Interpolate the track at session times (n,), within 0.5 s of its own epochs."""
    sigma = np.sqrt(np.maximum(np.einsum("nii->ni", track.covariance_m2), 0.0))
    as_reference = ReferenceSeries(t_s=track.t_s, position_m=track.position_m, sigma_m=sigma)
    at = interpolate(as_reference, t_s, 0.5)
    return _TrackAtFixes(position_m=at.position_m, sigma_m=at.sigma_m, known=at.usable)


def _track_nowhere(n: int) -> _TrackAtFixes:
    """Return a track that is known at none of n fixes."""
    return _TrackAtFixes(position_m=np.zeros((n, 3)), sigma_m=np.ones((n, 3)), known=np.zeros(n, dtype=np.bool_))


def _first_stale(
    reference: ReferenceSeries, track: _TrackAtFixes, start: int, end: int, config: EvaluationConfig
) -> int | None:
    """Return the first stale fix of the run ``start`` … ``end``, or None if the aircraft need not have moved."""
    held_s = float(reference.t_s[end] - reference.t_s[start])
    was_moving = _speed_before(reference, start) * held_s > config.frozen_min_motion_m
    repeats = bool(np.all(reference.position_m[start : end + 1] == reference.position_m[start])) and end - start >= 2
    known = np.flatnonzero(track.known[start : end + 1]) + start
    if len(known) < 2:
        return start + 1 if repeats and was_moving else None
    moved = np.abs(track.position_m[known] - track.position_m[known[0]])
    noise = np.hypot(track.sigma_m[known], track.sigma_m[known[0]])
    if repeats and was_moving:
        could_have = np.linalg.norm(moved[-1] + _STOPPED_SIGMA * noise[-1])
        stopped = could_have < 0.5 * _speed_before(reference, start) * held_s
        return None if stopped else start + 1
    # fixes that are as uncertain as this may be as far from each other as the track, and still within the tolerance
    apart = np.hypot(noise, np.hypot(reference.sigma_m[known], reference.sigma_m[known[0]]))
    enough = (moved > config.frozen_sigma * apart) & (moved > config.frozen_min_motion_m)
    gone = known[np.any(enough, axis=1)]
    if len(gone) < 2:
        return None
    if was_moving:
        return start + 1
    # it stood when the hold began, and moved off later: stale from where the track begins to leave
    leaving = known[np.any(moved > np.maximum(noise, config.frozen_tolerance_m), axis=1)]
    return int(leaving[0])


def _speed_before(reference: ReferenceSeries, k: int) -> float:
    """Return the speed in m/s with which the reference came to fix ``k``; 0 where nothing recent precedes it."""
    first = int(np.searchsorted(reference.t_s, reference.t_s[k] - _SPEED_WINDOW_S))
    if first >= k:
        return 0.0
    step = reference.position_m[k] - reference.position_m[first]
    return float(np.linalg.norm(step) / (reference.t_s[k] - reference.t_s[first]))


def _frozen_span(reference: ReferenceSeries, first: int, end: int) -> ExcludedSpan:
    """Describe the fixes ``first`` … ``end`` as frozen."""
    x, y, z = reference.position_m[end]
    from_s, to_s = float(reference.t_s[first]), float(reference.t_s[end])
    return ExcludedSpan(
        from_s=from_s,
        to_s=to_s,
        reason=ExclusionReason.FROZEN,
        detail=f"{end - first + 1} fixes held at ({x:.2f}, {y:.2f}, {z:.2f}) m while the aircraft moved",
    )


def find_glitches(reference: ReferenceSeries, config: EvaluationConfig) -> list[ExcludedSpan]:
    """Return fixes that jump off the path of their neighbours and come back, in the reference's clock."""
    return [
        ExcludedSpan(
            from_s=float(reference.t_s[glitch.first]),
            to_s=float(reference.t_s[glitch.last]),
            reason=ExclusionReason.GLITCH,
            detail=f"{glitch.last - glitch.first + 1} fixes {glitch.size_m:.2f} m off the path of their neighbours",
        )
        for glitch in find_glitch_runs(reference, config)
    ]
