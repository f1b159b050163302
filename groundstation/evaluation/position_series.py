"""Positions over time as arrays, and the interpolation of a reference between its fixes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.messages import DgpsFix

BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]

# 1 sigma from the median absolute deviation of normal noise
SIGMA_PER_MAD = 1.4826
# variance of the third difference of white noise, in variances of the noise
_THIRD_DIFFERENCE_VARIANCE = 20.0
_LEVER_WINDOW_S = 0.6
# longest repetition that is no hold: so long, or so many times what usually lies between two fixes that differ
_MAX_HOLD_S, _MAX_HOLD_STEPS = 0.3, 1.5
_MIN_HEADING_SPEED_M_S = 1.0
FALLBACK_SIGMA_M = 0.02
# stamps of a receiver at just the longest gap are a few ms apart from even: of 0.5 s, 25 ms are still no gap
_GAP_SLACK = 1.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PositionSeries:
    """Positions with covariance: ``t_s`` (n,) rising, ``position_m`` (n, 3) runway, ``covariance_m2`` (n, 3, 3)."""

    t_s: FloatArray
    position_m: FloatArray
    covariance_m2: FloatArray

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceSeries:
    """A reference's positions: ``t_s`` (n,) rising, its own clock; ``position_m`` (n, 3); ``sigma_m`` (n, 3)."""

    t_s: FloatArray
    position_m: FloatArray
    sigma_m: FloatArray

    def __len__(self) -> int:
        return len(self.t_s)

    def keep(self, mask: BoolArray) -> "ReferenceSeries":
        """Return the fixes of ``mask`` (n,) only; where that is all of them no copy of an hour's is made."""
        if mask.all():
            return self
        return ReferenceSeries(t_s=self.t_s[mask], position_m=self.position_m[mask], sigma_m=self.sigma_m[mask])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InterpolatedReference:
    """A reference at given times: position and velocity (m, 3), sigma (m, 3) and which are ``usable`` (m,)."""

    position_m: FloatArray
    velocity_m_s: FloatArray
    sigma_m: FloatArray
    usable: BoolArray


def reference_from_fixes(fixes: Sequence[DgpsFix]) -> ReferenceSeries:
    """Return the fixes as arrays in time order; of equal times the first stays.

    Rows that only repeat the fix before them, as logged faster than the receiver measures, are no new fixes and
    go; longer repetitions stay, to be judged. Sigmas that the file does not give are estimated from the fixes
    themselves (`white_noise_sigma`).
    """
    t = np.array([f.t_s for f in fixes], dtype=np.float64)
    points = np.array([f.position_runway_m for f in fixes], dtype=np.float64).reshape(-1, 3)
    _, first = np.unique(t, return_index=True)
    t, points = t[first], points[first]
    sigma = np.tile(white_noise_sigma(t, points), (len(t), 1))
    for row, k in enumerate(first):
        given = fixes[int(k)].sigma_m
        if given is not None and np.all(np.isfinite(given)) and np.all(given > 0):
            sigma[row] = given
    everything = ReferenceSeries(t_s=t, position_m=points, sigma_m=sigma)
    return everything.keep(~_short_repeats(everything))


def _short_repeats(reference: ReferenceSeries) -> BoolArray:
    """Return which fixes (n,) repeat their predecessor to the last digit, in runs that are no longer than usual."""
    same = np.concatenate([[False], np.all(np.diff(reference.position_m, axis=0) == 0, axis=1)])[: len(reference)]
    between_s = np.diff(reference.t_s[~same])
    longest_s = max(_MAX_HOLD_S, _MAX_HOLD_STEPS * float(np.median(between_s))) if len(between_s) else _MAX_HOLD_S
    for first, last in runs(same):
        if reference.t_s[last] - reference.t_s[first - 1] > longest_s:
            same[first : last + 1] = False
    return same


def runs(mask: BoolArray) -> list[tuple[int, int]]:
    """Return first and last index of each run of True in ``mask`` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def white_noise_sigma(t_s: FloatArray, position_m: FloatArray) -> FloatArray:
    """Estimate the white noise of a smooth path, (3,) in m, from third differences of evenly spaced fixes.

    Fixes that repeat their predecessor are left out: a held value has no noise to show.
    """
    if len(t_s) < 8:
        return np.full(3, FALLBACK_SIGMA_M)
    moved = np.concatenate([[True], np.any(np.diff(position_m, axis=0) != 0, axis=1)])
    t, p = t_s[moved], position_m[moved]
    if len(t) < 8:
        return np.full(3, FALLBACK_SIGMA_M)
    dt = np.diff(t)
    even = np.abs(dt - np.median(dt)) < 0.25 * np.median(dt)
    runs = even[:-2] & even[1:-1] & even[2:]
    third = np.diff(p, n=3, axis=0)[runs]
    if len(third) < 8:
        return np.full(3, FALLBACK_SIGMA_M)
    mad = np.median(np.abs(third), axis=0)
    return np.maximum(SIGMA_PER_MAD * mad / np.sqrt(_THIRD_DIFFERENCE_VARIANCE), 1e-3)


def is_gap(between_s: FloatArray, max_gap_s: float) -> BoolArray:
    """Return which times between fixes (n,) are longer than ``max_gap_s``, the stamps' own unevenness aside."""
    return np.asarray(between_s > _GAP_SLACK * max_gap_s)


def interpolate(reference: ReferenceSeries, t_s: FloatArray, max_gap_s: float) -> InterpolatedReference:
    """Interpolate a reference linearly at times (m,) of its own clock.

    Unusable are times outside its fixes and between fixes more than ``max_gap_s`` apart; there the numbers
    mean nothing.
    """
    n, m = len(reference), len(t_s)
    if n < 2:
        nothing = np.zeros((m, 3))
        return InterpolatedReference(
            position_m=nothing, velocity_m_s=nothing, sigma_m=nothing + 1.0, usable=np.zeros(m, dtype=np.bool_)
        )
    right, gap, share, usable = _between(reference.t_s, t_s, max_gap_s)
    left = right - 1
    position = reference.position_m
    return InterpolatedReference(
        position_m=position[left] + share * (position[right] - position[left]),
        velocity_m_s=(position[right] - position[left]) / gap[:, None],
        sigma_m=np.hypot((1 - share) * reference.sigma_m[left], share * reference.sigma_m[right]),
        usable=usable,
    )


def interpolate_positions(
    reference: ReferenceSeries, t_s: FloatArray, max_gap_s: float
) -> tuple[FloatArray, BoolArray]:
    """Return positions (m, 3) and which are usable (m,), as `interpolate`, in a fifth of its time."""
    if len(reference) < 2:
        return np.zeros((len(t_s), 3)), np.zeros(len(t_s), dtype=np.bool_)
    right, _, share, usable = _between(reference.t_s, t_s, max_gap_s)
    left, position = right - 1, reference.position_m
    return position[left] + share * (position[right] - position[left]), usable


def _between(
    fixes_s: FloatArray, t_s: FloatArray, max_gap_s: float
) -> tuple[IndexArray, FloatArray, FloatArray, BoolArray]:
    """Return of times (m,) the fix after each, the gap around it, where in it (m, 1), and whether it is usable."""
    right = np.clip(np.searchsorted(fixes_s, t_s, side="right"), 1, len(fixes_s) - 1)
    left = right - 1
    gap = fixes_s[right] - fixes_s[left]
    share = ((t_s - fixes_s[left]) / gap)[:, None]
    usable = (t_s >= fixes_s[0]) & (t_s <= fixes_s[-1]) & ~is_gap(gap, max_gap_s)
    # a time that falls on a fix needs no neighbour
    on_fix = (t_s == fixes_s[left]) | (t_s == fixes_s[right])
    return right, gap, share, usable | on_fix


def smooth_velocity(t_s: FloatArray, position_m: FloatArray, window_s: float) -> FloatArray:
    """Return the velocity (n, 3) of the straight line fitted to the fixes within ± half a window of each."""
    t0 = t_s - (t_s[0] if len(t_s) else 0.0)
    lo = np.searchsorted(t0, t0 - window_s / 2, side="left")
    hi = np.searchsorted(t0, t0 + window_s / 2, side="right")
    # a lone fix borrows its neighbours, so that there is a line at all
    lo = np.where(hi - lo < 2, np.maximum(lo - 1, 0), lo)
    hi = np.where(hi - lo < 2, np.minimum(hi + 1, len(t0)), hi)
    count = (hi - lo).astype(np.float64)

    def window_sum(values: FloatArray) -> FloatArray:
        total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        return total[hi] - total[lo]

    st, stt = window_sum(t0), window_sum(t0 * t0)
    origin = position_m[:1]
    sp, stp = window_sum(position_m - origin), window_sum(t0[:, None] * (position_m - origin))
    spread = stt - st * st / np.maximum(count, 1)
    spread = np.where(spread > 1e-12, spread, np.inf)
    return (stp - st[:, None] * sp / np.maximum(count, 1)[:, None]) / spread[:, None]


def nose_from_antenna(reference: ReferenceSeries, antenna_in_body_m: FloatArray) -> ReferenceSeries:
    """Move the fixes from the antenna to the nose: nose = antenna − R_runway_from_body · antenna_in_body.

    ``antenna_in_body_m`` (3,) is from the nose, x forward, y right, z down. Forward is the direction of the
    reference's own motion and the roll is zero; where it hardly moves, the nearest direction in time is kept.
    """
    if len(reference) < 2 or not np.any(antenna_in_body_m):
        return reference
    velocity = smooth_velocity(reference.t_s, reference.position_m, _LEVER_WINDOW_S)
    moving = np.flatnonzero(np.linalg.norm(velocity, axis=1) > _MIN_HEADING_SPEED_M_S)
    if len(moving) == 0:
        return reference
    after = np.clip(np.searchsorted(moving, np.arange(len(reference))), 0, len(moving) - 1)
    before = np.maximum(after - 1, 0)
    here = np.arange(len(reference))
    nearest = np.where(np.abs(moving[after] - here) <= np.abs(moving[before] - here), moving[after], moving[before])
    forward = velocity[nearest] / np.linalg.norm(velocity[nearest], axis=1, keepdims=True)
    right = np.cross(forward, np.array([0.0, 0.0, 1.0]))
    length = np.linalg.norm(right, axis=1, keepdims=True)
    right = np.where(length > 1e-6, right / np.maximum(length, 1e-6), np.array([1.0, 0.0, 0.0]))
    down = np.cross(forward, right)
    runway_from_body = np.stack([forward, right, down], axis=2)
    nose = reference.position_m - runway_from_body @ antenna_in_body_m
    return ReferenceSeries(t_s=reference.t_s, position_m=nose, sigma_m=reference.sigma_m)
