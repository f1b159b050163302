"""What leaves the path and comes back is a glitch; steps, manoeuvres and noise are not."""

import numpy as np
import pytest

from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.position_series import ReferenceSeries
from groundstation.evaluation.reference_glitches import find_glitch_runs

CONFIG = EvaluationConfig()


def _log(rng: np.random.Generator, rate_hz: float = 10.0, noise_m: float = 0.015) -> ReferenceSeries:
    t = np.arange(0.0, 40.0, 1.0 / rate_hz)
    path = np.column_stack([3 * np.sin(t), 500 - 15 * t, 20 + np.cos(t / 3)])
    return ReferenceSeries(
        t_s=t, position_m=path + noise_m * rng.normal(size=path.shape), sigma_m=np.full_like(path, noise_m)
    )


def _moved(log: ReferenceSeries, fixes: slice, by_m: tuple[float, float, float]) -> ReferenceSeries:
    points = log.position_m.copy()
    points[fixes] += by_m
    return ReferenceSeries(t_s=log.t_s, position_m=points, sigma_m=log.sigma_m)


def test_noise_alone_has_none(rng: np.random.Generator) -> None:
    assert not find_glitch_runs(_log(rng), CONFIG)


@pytest.mark.parametrize("length", [1, 2, 4, 6])
def test_exactly_the_moved_fixes_are_found(rng: np.random.Generator, length: int) -> None:
    moved = _moved(_log(rng), slice(100, 100 + length), (0.5, -0.4, 0.3))
    (glitch,) = find_glitch_runs(moved, CONFIG)
    assert (glitch.first, glitch.last) == (100, 100 + length - 1)
    assert glitch.size_m == pytest.approx(0.7, abs=0.2)


def test_several_are_found_in_order(rng: np.random.Generator) -> None:
    log = _log(rng)
    for first in (50, 55, 200):
        log = _moved(log, slice(first, first + 1), (0.0, 0.0, 1.0))
    assert [g.first for g in find_glitch_runs(log, CONFIG)] == [50, 55, 200]


@pytest.mark.parametrize("step_m", [(0.5, 0.5, 1.0), (0.2, -0.2, 0.1), (0.0, 5.0, 0.0)])
def test_a_step_that_stays_is_no_glitch(rng: np.random.Generator, step_m: tuple[float, float, float]) -> None:
    """Expected: losing the fixed solution moves all later fixes; none of them has come back."""
    for _ in range(5):
        assert not find_glitch_runs(_moved(_log(rng), slice(200, None), step_m), CONFIG)


@pytest.mark.parametrize("rate_hz", [25.0, 50.0, 100.0])
def test_a_glitch_of_a_fast_log_is_found_as_long_as_it_may_be(rng: np.random.Generator, rate_hz: float) -> None:
    """Expected: half a second is a glitch at any rate, and noise or a step that stays at none."""
    log = _log(rng, rate_hz)
    assert not find_glitch_runs(log, CONFIG)
    length = round(0.5 * rate_hz)
    (glitch,) = find_glitch_runs(_moved(log, slice(500, 500 + length), (0.5, -0.4, 3.0)), CONFIG)
    assert (glitch.first, glitch.last) == (500, 500 + length - 1)
    assert glitch.size_m == pytest.approx(3.1, abs=0.5)
    assert not find_glitch_runs(_moved(log, slice(500, None), (0.5, 0.5, 1.0)), CONFIG)


@pytest.mark.parametrize("rate_hz", [5.0, 50.0])
def test_hard_manoeuvres_are_no_glitches(rng: np.random.Generator, rate_hz: float) -> None:
    """Expected: loops of 12 m at 25 m/s keep at least 99 % of their fixes."""
    t = np.arange(0.0, 40.0, 1.0 / rate_hz)
    turn = 25.0 / 12.0 * t
    path = np.column_stack([12 * np.cos(turn), 200 + 12 * np.sin(turn), 50 + 5 * np.sin(turn / 3)])
    log = ReferenceSeries(
        t_s=t, position_m=path + 0.015 * rng.normal(size=path.shape), sigma_m=np.full_like(path, 0.015)
    )
    assert sum(g.last - g.first + 1 for g in find_glitch_runs(log, CONFIG)) <= 2


@pytest.mark.parametrize("n", [0, 1, 5, 12, 13])
def test_short_logs_are_no_reason_to_fail(n: int) -> None:
    log = ReferenceSeries(t_s=np.arange(n) * 0.1, position_m=np.zeros((n, 3)), sigma_m=np.ones((n, 3)))
    assert not find_glitch_runs(log, CONFIG)


@pytest.mark.parametrize("flips", [2, 3, 5])
def test_fixes_that_flip_to_another_solution_and_back(rng: np.random.Generator, flips: int) -> None:
    """Every other fix 1.2 m off, as of a receiver between two solutions: those, and not the good ones between."""
    log = _log(rng, rate_hz=5.0)
    bad = [100 + 2 * k for k in range(flips)]
    points = log.position_m.copy()
    points[bad] += (-1.2, -0.3, 0.4)
    flipping = ReferenceSeries(t_s=log.t_s, position_m=points, sigma_m=log.sigma_m)
    found = find_glitch_runs(flipping, CONFIG)
    assert [g.first for g in found] == [g.last for g in found] == bad


def test_one_fix_off_is_found_once(rng: np.random.Generator) -> None:
    moved = _moved(_log(rng, rate_hz=5.0), slice(90, 91), (-1.2, -0.3, 0.4))
    assert [(g.first, g.last) for g in find_glitch_runs(moved, CONFIG)] == [(90, 90)]
