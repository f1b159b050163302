"""Fault scenarios: a good DGPS log edited, and the faults that the evaluation must find, stated in each docstring."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.evaluation.checked_reference import CheckedReference, check_reference
from groundstation.evaluation.config import EvaluationConfig, OffsetSource
from groundstation.evaluation.evaluate import track_series, triangulated_series
from groundstation.evaluation.position_series import PositionSeries
from groundstation.evaluation.reference_exclusion import ExcludedSpan, ExclusionReason
from groundstation.evaluation.reference_time_offset import NoOffset, TimeOffset
from groundstation.messages import DgpsFix
from groundstation.rig.rig import Rig, load_rig
from tests.evaluation.synthetic import Path3D, fixes_of, read_path, run_on

OFFSET_S = 0.3
HELD_FROM_S, HELD_TO_S = 15.0, 18.0

Check = Callable[[list[DgpsFix]], CheckedReference]


@pytest.fixture
def check(landing_track: PositionSeries, landing_points: PositionSeries) -> Check:
    return lambda fixes: check_reference(fixes, landing_track, landing_points, None, EvaluationConfig())


def _offset(found: CheckedReference) -> TimeOffset:
    assert isinstance(found.offset, TimeOffset)
    return found.offset


def _spans(found: CheckedReference, reason: ExclusionReason) -> list[ExcludedSpan]:
    return [s for s in found.excluded if s.reason is reason]


def _worst_error(found: CheckedReference, truth: Path3D) -> float:
    """Return the largest error of what the comparison would use, against the truth."""
    at = found.at(truth.t_s)
    return float(np.abs(at.position_m - truth.position_runway_m)[at.usable].max())


def _hold(fixes: list[DgpsFix], from_s: float, to_s: float) -> list[DgpsFix]:
    """Hold the position of the first fix after ``from_s`` until ``to_s`` (DGPS clock)."""
    held = next(f for f in fixes if f.t_s >= from_s).position_runway_m
    return [replace(f, position_runway_m=held) if from_s <= f.t_s < to_s else f for f in fixes]


def _late(
    fixes: list[DgpsFix], truth: Path3D, from_s: float, lag: Callable[[float], float], rng: np.random.Generator
) -> list[DgpsFix]:
    """From ``from_s`` on, report where the aircraft was ``lag(seconds since)`` before."""
    edited = []
    for f in fixes:
        if f.t_s >= from_s:
            then = np.array([f.t_s - OFFSET_S - lag(f.t_s - from_s)])
            edited.append(replace(f, position_runway_m=truth.at(then)[0] + 0.015 * rng.normal(size=3)))
        else:
            edited.append(f)
    return edited


def test_clean_log_is_used_whole(check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D) -> None:
    """Expected: nothing left out; the offset +0.3 s (DGPS late) within 4 sigma, sigma of a few ms."""
    found = check(landing_fixes)
    offset = _offset(found)
    assert not found.excluded
    assert offset.sigma_s < 0.015
    assert abs(offset.offset_s - OFFSET_S) < 4 * offset.sigma_s
    assert found.at(landing_truth.t_s).usable.mean() > 0.98


@pytest.mark.parametrize("offset_s", [-0.7, -0.3, 0.0, 1.25])
def test_offset_sign_follows_the_convention(
    landing_truth: Path3D, check: Check, rng: np.random.Generator, offset_s: float
) -> None:
    """Expected: t_dgps = t_session + offset; a DGPS that is early has a negative offset."""
    offset = _offset(check(fixes_of(landing_truth, offset_s, rng)))
    assert abs(offset.offset_s - offset_s) < min(4 * offset.sigma_s, 0.03)


def test_offset_is_only_reported_where_the_clocks_are_one(
    landing_track: PositionSeries,
    landing_points: PositionSeries,
    landing_fixes: list[DgpsFix],
    landing_truth: Path3D,
) -> None:
    """Expected: a session on DGPS time is compared as stated; the 0.3 s that contradict it are found and shown."""
    found = check_reference(landing_fixes, landing_track, landing_points, None, EvaluationConfig(), clocks_given=True)
    assert _offset(found).offset_s == pytest.approx(OFFSET_S, abs=0.03)
    assert found.applied_offset_s == 0.0
    assert _worst_error(found, landing_truth) > 3.0


def test_offset_sigma_is_consistent(landing_truth: Path3D, rig: Rig) -> None:
    """Expected: over 12 runs the errors are about as large as stated, for triangulation and track."""
    scores: dict[OffsetSource, list[float]] = {s: [] for s in OffsetSource}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        epochs = run_on(landing_truth, rig, rng).epochs()
        fixes = fixes_of(landing_truth, OFFSET_S, rng)
        for source, values in scores.items():
            config = EvaluationConfig(offset_from=source)
            offset = _offset(check_reference(fixes, track_series(epochs), triangulated_series(epochs), None, config))
            values.append((offset.offset_s - OFFSET_S) / offset.sigma_s)
    for values in scores.values():
        low, high = chi2.ppf([0.001, 0.999], len(values))
        assert low < np.sum(np.square(values)) < high


def test_held_constant_to_the_end(check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D) -> None:
    """Expected: frozen from the second held fix to the last; the rest is compared, with the right offset."""
    found = check(_hold(landing_fixes, HELD_FROM_S, np.inf))
    (span,) = _spans(found, ExclusionReason.FROZEN)
    assert span.from_s == pytest.approx(HELD_FROM_S - OFFSET_S, abs=0.3)
    assert span.to_s == pytest.approx(landing_fixes[-1].t_s - OFFSET_S, abs=0.1)
    assert "held at" in span.detail
    assert abs(_offset(found).offset_s - OFFSET_S) < 4 * _offset(found).sigma_s
    assert _worst_error(found, landing_truth) < 0.8


@pytest.mark.parametrize("jitter_m", [0.0, 0.005])
def test_held_and_resumed(
    check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D, rng: np.random.Generator, jitter_m: float
) -> None:
    """Expected: the held seconds are left out, also when the receiver's last digits still flicker; the rest stays."""
    held = [
        replace(f, position_runway_m=f.position_runway_m + jitter_m * rng.normal(size=3))
        if HELD_FROM_S < f.t_s < HELD_TO_S
        else f
        for f in _hold(landing_fixes, HELD_FROM_S, HELD_TO_S)
    ]
    found = check(held)
    assert {s.reason for s in found.excluded} == {ExclusionReason.FROZEN}
    assert found.excluded[0].from_s == pytest.approx(HELD_FROM_S - OFFSET_S, abs=0.3)
    assert found.excluded[-1].to_s == pytest.approx(HELD_TO_S - OFFSET_S, abs=0.2)
    assert abs(_offset(found).offset_s - OFFSET_S) < 4 * _offset(found).sigma_s
    assert _worst_error(found, landing_truth) < 0.5
    assert found.at(landing_truth.t_s).usable.mean() > 0.85


@pytest.mark.parametrize("rate", [0.05, 0.2])
def test_held_then_resumed_with_growing_lag(
    check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D, rng: np.random.Generator, rate: float
) -> None:
    """Expected: frozen, then lagging from the very resumption to the end; the offset is that of the good start.

    More than half of the log is bad, so that a majority would be wrong.
    """
    late = _late(_hold(landing_fixes, HELD_FROM_S, HELD_TO_S), landing_truth, HELD_TO_S, lambda s: rate * s, rng)
    found = check(late)
    assert [s.reason for s in found.excluded] == [ExclusionReason.FROZEN, ExclusionReason.LAGGING]
    frozen, lagging = found.excluded
    assert lagging.from_s == pytest.approx(frozen.to_s, abs=0.05)
    assert lagging.to_s > late[-1].t_s - 0.6
    assert "since it was frozen" in lagging.detail
    assert abs(_offset(found).offset_s - OFFSET_S) < 4 * _offset(found).sigma_s
    assert _worst_error(found, landing_truth) < 1.0


def test_held_then_resumed_late_for_good(
    check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D, rng: np.random.Generator
) -> None:
    """Expected: a receiver that returns 2 s late is lagging, although most of the log does not show it."""
    late = _late(_hold(landing_fixes, 8.0, 10.0), landing_truth, 10.0, lambda _: 2.0, rng)
    found = check(late)
    assert _spans(found, ExclusionReason.LAGGING)
    assert abs(_offset(found).offset_s - OFFSET_S) < 4 * _offset(found).sigma_s


def test_lag_without_a_freeze(
    check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D, rng: np.random.Generator
) -> None:
    """Expected: a lag growing to 1.5 s is found where all three axes show it, and nothing before it is lost."""
    late = _late(landing_fixes, landing_truth, 18.0, lambda s: 0.1 * s, rng)
    found = check(late)
    (span,) = found.excluded
    assert span.reason is ExclusionReason.LAGGING
    assert 16.0 < span.from_s < 21.0
    assert abs(_offset(found).offset_s - OFFSET_S) < 4 * _offset(found).sigma_s


def test_gap_is_refused(check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D) -> None:
    """Expected: 3 s without a fix is missing and not interpolated; the fixes on either side still are."""
    kept = [f for f in landing_fixes if not 10.0 < f.t_s < 13.0]
    found = check(kept)
    (span,) = found.excluded
    assert span.reason is ExclusionReason.MISSING
    assert (span.from_s, span.to_s) == pytest.approx((10.0 - OFFSET_S, 13.0 - OFFSET_S), abs=0.11)
    at = found.at(landing_truth.t_s)
    assert not at.usable[(landing_truth.t_s > span.from_s) & (landing_truth.t_s < span.to_s)].any()
    assert at.usable.mean() > 0.88


def test_glitches_are_left_out(check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D) -> None:
    """Expected: single fixes and short runs that jump away and back are glitches; their neighbours stay."""
    edited = list(landing_fixes)
    for k in (60, 61, 62, 150):
        edited[k] = replace(edited[k], position_runway_m=edited[k].position_runway_m + np.array([0.8, 0.0, -0.5]))
    found = check(edited)
    assert [s.reason for s in found.excluded] == [ExclusionReason.GLITCH] * 2
    assert [s.from_s + OFFSET_S for s in found.excluded] == pytest.approx([edited[60].t_s, edited[150].t_s], abs=0.05)
    assert _worst_error(found, landing_truth) < 0.3


def test_standing_aircraft_is_not_frozen(rig: Rig, rng: np.random.Generator) -> None:
    """Expected: eight seconds at rest, then a take-off run: nothing is left out, with noise or exact repeats."""
    t = np.arange(0.5, 20.5, 0.05)
    run_s = np.maximum(t - 8.5, 0.0)
    points = np.column_stack([0.6 + 0 * t, 200.0 - 1.5 * run_s**2, 0.3 + 0.02 * np.maximum(run_s - 5, 0) ** 2])
    path = Path3D(t_s=t, position_runway_m=points)
    epochs = run_on(path, rig, rng).epochs()
    for noise_m in (0.015, 0.0):
        fixes = fixes_of(path, 0.15, rng, noise_m=noise_m)
        found = check_reference(fixes, track_series(epochs), triangulated_series(epochs), None, EvaluationConfig())
        assert not found.excluded
        assert abs(_offset(found).offset_s - 0.15) < 4 * _offset(found).sigma_s + 1e-3


@pytest.mark.parametrize("sigma_m", [1.0, 3.0])
def test_an_uncertain_log_is_not_frozen(
    check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D, sigma_m: float
) -> None:
    """Expected: fixes a few sigmas apart, as of a receiver without corrections, are left in; held ones are not."""
    uncertain = [replace(f, sigma_m=np.full(3, sigma_m)) for f in landing_fixes]
    found = check(uncertain)
    assert not found.excluded
    assert found.at(landing_truth.t_s).usable.mean() > 0.95
    held = check(_hold(uncertain, HELD_FROM_S, HELD_TO_S))
    assert ExclusionReason.FROZEN in {s.reason for s in held.excluded}


@pytest.mark.parametrize("session", ["landing-1", "takeoff-1"])
def test_recorded_logs_lose_no_valid_fix(session: str, shared_data: Path, rng: np.random.Generator) -> None:
    """Expected: on the rendered sessions' own DGPS at most 1 % of the fixes is left out for anything but gaps."""
    folder = shared_data / session
    truth, log = read_path(folder / "truth.csv"), read_path(folder / "dgps.csv")
    fixes = [DgpsFix(t_s=float(t), position_runway_m=p) for t, p in zip(log.t_s, log.position_runway_m, strict=True)]
    epochs = run_on(truth, load_rig(folder / "rig.toml"), rng).epochs()
    found = check_reference(fixes, track_series(epochs), triangulated_series(epochs), None, EvaluationConfig())
    assert len(found.fixes) >= 0.99 * len(fixes)
    assert not _spans(found, ExclusionReason.LAGGING)
    assert _worst_error(found, truth) < 0.3


@pytest.mark.parametrize("move_m", [(8.0, 30.0, 4.0), (3.0, 0.0, 0.0), (0.0, -40.0, 0.0)])
def test_a_track_astray_does_not_condemn_the_reference(
    landing_track: PositionSeries,
    landing_points: PositionSeries,
    landing_fixes: list[DgpsFix],
    move_m: tuple[float, float, float],
) -> None:
    """Expected: where the track follows something else for 3 s, the reference is kept: the error is the track's."""

    def astray(series: PositionSeries) -> PositionSeries:
        points = series.position_m.copy()
        points[(series.t_s > 14.0) & (series.t_s < 17.0)] += move_m
        return PositionSeries(t_s=series.t_s, position_m=points, covariance_m2=series.covariance_m2)

    found = check_reference(landing_fixes, astray(landing_track), astray(landing_points), None, EvaluationConfig())
    assert not found.excluded
    assert abs(_offset(found).offset_s - OFFSET_S) < 4 * _offset(found).sigma_s


@pytest.mark.parametrize("bias_deg", [-0.05, 0.05])
def test_a_calibration_error_does_not_condemn_the_reference(
    landing_truth: Path3D, landing_fixes: list[DgpsFix], rig: Rig, rng: np.random.Generator, bias_deg: float
) -> None:
    """Expected: 0.05° of relative pan (3 m in y at 200 m) leaves every fix in, also after a gap."""
    epochs = run_on(landing_truth, rig, rng, pan_bias_rad=float(np.radians(bias_deg))).epochs()
    kept = [f for f in landing_fixes if not 10.0 < f.t_s < 12.0]
    found = check_reference(kept, track_series(epochs), triangulated_series(epochs), None, EvaluationConfig())
    assert {s.reason for s in found.excluded} == {ExclusionReason.MISSING}


def test_log_faster_than_the_receiver(check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D) -> None:
    """Expected: each fix logged twice is a reference of half the rate, nothing frozen."""
    doubled = [
        replace(f, position_runway_m=landing_fixes[k - k % 2].position_runway_m) for k, f in enumerate(landing_fixes)
    ]
    found = check(doubled)
    assert not found.excluded
    assert _worst_error(found, landing_truth) < 0.3


@pytest.mark.parametrize("every", [4, 5])
def test_log_much_faster_than_the_receiver(
    check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D, every: int
) -> None:
    """Expected: fixes at 2.5 or 2 Hz, logged at 10 Hz, are a reference of that rate; a hold of 3 s still is one."""
    repeated = [
        replace(f, position_runway_m=landing_fixes[k - k % every].position_runway_m)
        for k, f in enumerate(landing_fixes)
    ]
    found = check(repeated)
    assert not found.excluded
    assert found.at(landing_truth.t_s).usable.mean() > 0.9
    assert _worst_error(found, landing_truth) < 0.5
    held = check(_hold(repeated, HELD_FROM_S, HELD_TO_S))
    assert {s.reason for s in held.excluded} & {ExclusionReason.FROZEN, ExclusionReason.MISSING}


def test_stamps_at_just_the_longest_gap_may_be_uneven(
    check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D, rng: np.random.Generator
) -> None:
    """Expected: 2 fixes a second, stamped to a few ms, are all compared with; half of them were called missing."""
    uneven = [replace(f, t_s=f.t_s + float(rng.uniform(-0.004, 0.004))) for f in landing_fixes[::5]]
    found = check(uneven)
    assert not found.excluded
    assert found.at(landing_truth.t_s).usable.mean() > 0.9


def test_log_too_slow_to_interpolate(check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D) -> None:
    """Expected: one fix a second is refused as one span, not as thirty."""
    found = check(landing_fixes[::10])
    (span,) = found.excluded
    assert span.reason is ExclusionReason.MISSING
    assert "apart" in span.detail
    assert not found.at(landing_truth.t_s).usable.any()


def test_no_overlap_gives_a_reason(check: Check, landing_fixes: list[DgpsFix], landing_truth: Path3D) -> None:
    """Expected: a log of another hour gives no offset, with a reason, and nothing is compared."""
    found = check([replace(f, t_s=f.t_s + 3600.0) for f in landing_fixes])
    assert isinstance(found.offset, NoOffset)
    assert found.offset.reason
    assert not found.at(landing_truth.t_s).usable.any()
