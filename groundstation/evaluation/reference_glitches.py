"""Glitches of a reference: fixes that leave its path and return to it."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.position_series import IndexArray, ReferenceSeries

MAX_RUN = 12
_PASSES = 6
_ROUNDING = 1e-6
_LOCAL_WINDOW_S = 6.0
_LOCAL_FACTOR = 6.0
_ALIKE = 0.4
_MISMATCH_SIGMA = 4.0
_MAX_NEIGHBOUR_GAP_S = 1.2
# the fixes that a run is compared with, counted from its ends: next to it, or every other one
_BESIDE = (-2, -1, 1, 2)
_EVERY_OTHER = (-3, -1, 1, 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Glitch:
    """Fixes ``first`` … ``last`` are all at least ``size_m`` off the path of the fixes around them."""

    first: int
    last: int
    size_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Candidates:
    """Runs of one length starting at fix ``start`` (m,).

    How far off all of it is and the worst of it is, and how badly the outer fixes fit, (m,) each.
    """

    start: IndexArray
    departure_m: FloatArray
    furthest_m: FloatArray
    mismatch_m: FloatArray


def find_glitch_runs(reference: ReferenceSeries, config: EvaluationConfig) -> list[Glitch]:
    """Return the runs of fixes, no longer than ``config.glitch_max_s``, that leave the path and come back.

    A run is compared with the cubic through the two fixes on either side. It is a glitch if it departs further
    than noise, than the configured least, and several times further than runs of its length do nearby: an
    aircraft in hard manoeuvres leaves such cubics all the time. A step that does not come back is none.
    A receiver that flips between two solutions alternates good and bad fixes; those are found first.
    """
    found = _flips(reference, config)
    found += _left_path(reference, _others(reference, found), config)
    # of fixes that follow each other fast, the longest glitches are more than a run: every few of them are looked at
    every = _thinning(reference, config)
    if every > 1:
        rest = _others(reference, found)
        longer = [glitch for k in range(every) for glitch in _left_path(reference, rest[k::every], config)]
        found += _merged(longer)
    return sorted(found, key=lambda g: g.first)


def _others(reference: ReferenceSeries, found: list[Glitch]) -> IndexArray:
    """Return the fixes that are in no glitch yet."""
    alive = np.ones(len(reference), dtype=np.bool_)
    for glitch in found:
        alive[glitch.first : glitch.last + 1] = False
    return np.flatnonzero(alive)


def _thinning(reference: ReferenceSeries, config: EvaluationConfig) -> int:
    """Return of how many fixes one is looked at so that the longest glitch is a run of `MAX_RUN`."""
    if len(reference) < MAX_RUN:
        return 1
    step_s = float(np.median(np.diff(reference.t_s)))
    return math.ceil(config.glitch_max_s / (MAX_RUN * max(step_s, 1e-3)) - _ROUNDING)


def _left_path(reference: ReferenceSeries, chosen: IndexArray, config: EvaluationConfig) -> list[Glitch]:
    """Return the runs of the ``chosen`` (n,) fixes that leave the path of the others, the clearest ones first."""
    found, alive = [], chosen
    for _ in range(_PASSES):
        kept = ReferenceSeries(
            t_s=reference.t_s[alive], position_m=reference.position_m[alive], sigma_m=reference.sigma_m[alive]
        )
        picked = _pick(kept, config)
        if not picked:
            break
        gone = np.zeros(len(alive), dtype=np.bool_)
        for glitch in picked:
            found.append(Glitch(first=int(alive[glitch.first]), last=int(alive[glitch.last]), size_m=glitch.size_m))
            gone[glitch.first : glitch.last + 1] = True
        alive = alive[~gone]
    return found


def _merged(glitches: list[Glitch]) -> list[Glitch]:
    """Return glitches, those that follow each other as one of the size that all of it has at least."""
    merged: list[Glitch] = []
    for glitch in sorted(glitches, key=lambda g: g.first):
        if merged and glitch.first <= merged[-1].last + 1:
            before = merged[-1]
            last, size_m = max(before.last, glitch.last), min(before.size_m, glitch.size_m)
            merged[-1] = Glitch(first=before.first, last=last, size_m=size_m)
        else:
            merged.append(glitch)
    return merged


def _pick(reference: ReferenceSeries, config: EvaluationConfig) -> list[Glitch]:
    """Return the runs that stand out most, none next to another."""
    if len(reference) < MAX_RUN:
        return []
    step_s = float(np.median(np.diff(reference.t_s)))
    longest = int(np.clip(config.glitch_max_s / max(step_s, 1e-6) + 1, 1, MAX_RUN))
    options = []
    for length in range(1, longest + 1):
        options += _off_the_path(reference, length, _BESIDE, config)
    options.sort(key=lambda g: -g.size_m)
    taken = np.zeros(len(reference) + 4, dtype=np.bool_)
    picked = []
    for option in options:
        around = slice(max(0, option.first - 2), option.last + 3)
        if not taken[around].any():
            taken[around] = True
            picked.append(option)
    return picked


def _flips(reference: ReferenceSeries, config: EvaluationConfig) -> list[Glitch]:
    """Return every other fix of a stretch in which two or more are off the path of those between them."""
    if len(reference) < MAX_RUN:
        return []
    off = {g.first: g for g in _off_the_path(reference, 1, _EVERY_OTHER, config)}
    return [g for k, g in sorted(off.items()) if k - 2 in off or k + 2 in off]


def _off_the_path(
    reference: ReferenceSeries, length: int, around: tuple[int, int, int, int], config: EvaluationConfig
) -> list[Glitch]:
    """Return the runs of one length that leave the cubics through the fixes ``around`` them."""
    c = _candidates(reference, length, around)
    noise = np.linalg.norm(reference.sigma_m, axis=1)[c.start] if len(c.start) else np.zeros(0)
    limit = np.maximum(config.glitch_min_m, config.glitch_sigma * noise)
    limit = np.maximum(limit, _LOCAL_FACTOR * _local_median(reference.t_s[c.start], c.furthest_m))
    off = (c.departure_m > limit) & (c.mismatch_m < 0.5 * c.departure_m + _MISMATCH_SIGMA * noise)
    return [
        Glitch(first=int(c.start[k]), last=int(c.start[k]) + length - 1, size_m=float(c.departure_m[k]))
        for k in np.flatnonzero(off)
    ]


def _candidates(reference: ReferenceSeries, length: int, around: tuple[int, int, int, int]) -> _Candidates:
    """Return every run of ``length`` fixes with two neighbours on either side close in time."""
    widest, outermost = around[3], 2 * around[3] - 1
    start = np.arange(widest, len(reference) - length - widest + 1)
    anchors = np.stack([start + k if k < 0 else start + length - 1 + k for k in around])
    if not len(start):
        return _Candidates(start=start, departure_m=np.zeros(0), furthest_m=np.zeros(0), mismatch_m=np.zeros(0))
    t, p = reference.t_s[anchors], reference.position_m[anchors]
    longest_s = _MAX_NEIGHBOUR_GAP_S * widest / _BESIDE[3]
    near = t[3] - t[0] < longest_s + (length - 1) * np.median(np.diff(reference.t_s))
    least, most = np.full(len(start), np.inf), np.zeros(len(start))
    for k in range(length):
        predicted = _lagrange(t, p, reference.t_s[start + k])
        off = np.linalg.norm(reference.position_m[start + k] - predicted, axis=1)
        least, most = np.minimum(least, off), np.maximum(most, off)
    # fixes that are off by very different amounts are a step smoothed by the cubic, or a turn
    departure = np.where(least > _ALIKE * most, least, 0.0)
    # the same cubic must lead on to the next fix on either side: after a step it does not
    mismatch = np.zeros(len(start))
    outer_fixes = (start - outermost, start + length - 1 + outermost)
    for outer in (np.clip(fixes, 0, len(reference) - 1) for fixes in outer_fixes):
        led_to = _lagrange(t, p, reference.t_s[outer])
        mismatch = np.maximum(mismatch, np.linalg.norm(reference.position_m[outer] - led_to, axis=1))
    return _Candidates(start=start[near], departure_m=departure[near], furthest_m=most[near], mismatch_m=mismatch[near])


def _lagrange(t_s: FloatArray, points_m: FloatArray, at_s: FloatArray) -> FloatArray:
    """Evaluate at times (m,) the cubics through four points each: ``t_s`` (4, m), ``points_m`` (4, m, 3)."""
    total = np.zeros_like(points_m[0])
    for i in range(4):
        weight = np.ones_like(at_s)
        for j in range(4):
            if j != i:
                weight = weight * (at_s - t_s[j]) / (t_s[i] - t_s[j])
        total += weight[:, None] * points_m[i]
    return total


def _local_median(t_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the median of values (m,) within blocks of time around each, the larger of two overlapping blocks."""
    result = np.zeros(len(values))
    if not len(values):
        return result
    for shift in (0.0, 0.5):
        block = np.floor((t_s - t_s[0]) / _LOCAL_WINDOW_S + shift).astype(np.intp)
        edges = np.concatenate([[0], np.flatnonzero(np.diff(block)) + 1, [len(values)]])
        for first, last in pairwise(edges):
            result[first:last] = np.maximum(result[first:last], np.median(values[first:last]))
    return result
