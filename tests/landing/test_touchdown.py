"""The touchdown foretold: the ellipse holds what it states under the stated prior."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, ScenarioError
from groundstation.landing.touchdown import NoTouchdown, TouchdownBasis, TouchdownForecast, TouchdownPredictor
from groundstation.landing_site.approach_prior import ApproachPrior, PathHold, WheelPosition
from groundstation.messages import Kinematics
from groundstation.simulation.planned_landing import PlannedLanding, draw_planned_landing
from tests.landing.approaches import GLIDE_RAD, SIGMAS, SITE, SPEED_M_S, WHEELS, estimate

_FLIGHTS = 40
# fewer than the default: the quantile of the ellipse scatters by 1.3 %
_SAMPLES = 300
_BEFORE_S = (10.0, 5.0, 2.0)
_EXACT = np.full(6, 1e-6)


@pytest.fixture(scope="module")
def predictor() -> TouchdownPredictor:
    return TouchdownPredictor(SITE, WHEELS, samples=_SAMPLES)


@pytest.fixture(scope="module")
def flights() -> list[PlannedLanding]:
    prior = ApproachPrior()
    return [
        draw_planned_landing(
            np.random.default_rng([seed, 7]), SITE, prior=prior, wheels=WHEELS, start_before_aim_m=220.0
        )
        for seed in range(_FLIGHTS)
    ]


def _on_glide_path(along_m: float, site_sigmas: FloatArray = SIGMAS) -> Kinematics:
    assert SITE.approach is not None
    there = np.array([along_m, 0.0, SITE.approach.height_m(along_m)])
    return estimate(there, np.array([SPEED_M_S, 0.0, -SPEED_M_S * math.tan(GLIDE_RAD)]), sigmas=site_sigmas)


def _foretold(
    predictor: TouchdownPredictor, flights: Sequence[PlannedLanding], before_s: float, sigmas: FloatArray
) -> list[TouchdownForecast | None]:
    found: list[TouchdownForecast | None] = []
    for seed, flown in enumerate(flights):
        t_s = flown.touchdown_s - before_s
        at = np.array([t_s])
        off = np.random.default_rng([seed, 8]).normal(size=6) * sigmas
        kinematics = Kinematics(
            position_runway_m=flown.trajectory.position(at)[0] + off[:3],
            velocity_runway_m_s=flown.trajectory.velocity(at)[0] + off[3:],
            covariance=np.diag(sigmas**2),
        )
        answer = predictor.forecast(t_s, kinematics)
        found.append(answer if isinstance(answer, TouchdownForecast) else None)
    return found


@pytest.mark.parametrize("before_s", _BEFORE_S)
def test_the_ellipse_holds_what_it_states(
    predictor: TouchdownPredictor, flights: list[PlannedLanding], before_s: float
) -> None:
    """Expected: 95 % inside by the plan, within the binomial's two-sided range of 1 in 1000; sigmas hardly wider."""
    measured = _foretold(predictor, flights, before_s, SIGMAS)
    exact = _foretold(predictor, flights, before_s, _EXACT)
    pairs = [(f, e, flown) for f, e, flown in zip(measured, exact, flights, strict=True) if f and e]
    assert len(pairs) >= _FLIGHTS - 3
    inside = sum(f.contains(flown.touchdown_m) for f, _, flown in pairs)
    low, high = binom.ppf([0.0005, 0.9995], len(pairs), 0.95)
    assert low <= inside <= high
    assert {f.basis for f, _, _ in pairs} == {TouchdownBasis.PLAN}
    ours, best = (np.mean([np.diag(p[k].covariance_m2) for p in pairs], axis=0) for k in (0, 1))
    assert np.all(np.sqrt(ours / best) <= 1.2)
    late = np.array([(flown.touchdown_s - f.t_s) / f.sigma_t_s for f, _, flown in pairs])
    assert abs(late.mean()) < 0.6
    assert 0.6 < late.std() < 1.25


def test_the_ellipse_shrinks_towards_the_touchdown(
    predictor: TouchdownPredictor, flights: list[PlannedLanding]
) -> None:
    means = []
    for before_s in _BEFORE_S:
        found = [f for f in _foretold(predictor, flights[:10], before_s, SIGMAS) if f]
        means.append(np.mean([f.half_axes_m for f in found], axis=0))
    assert np.all(np.diff(means, axis=0) < 0.0)


def test_a_spread_that_is_stated_too_small_is_found_out(flights: list[PlannedLanding]) -> None:
    """Expected: with a third of the true spread far fewer are inside, so the test above can fail."""
    narrow = ApproachPrior(vertical_sigma_m=0.23, flare_height_sigma_log=0.1, touchdown_sink_sigma_log=0.12)
    found = _foretold(TouchdownPredictor(SITE, WHEELS, narrow, _SAMPLES), flights, 10.0, SIGMAS)
    inside = sum(f is not None and f.contains(flown.touchdown_m) for f, flown in zip(found, flights, strict=True))
    assert inside < binom.ppf(0.0005, _FLIGHTS, 0.95)


@dataclass(frozen=True)
class _Straight:
    """A flight of constant velocity but for white acceleration."""

    state: FloatArray
    touchdown_m: FloatArray


def _straight(seed: int, psd: tuple[float, float, float]) -> _Straight:
    generator = np.random.default_rng([seed, 3])
    sink = 2.5
    state = np.array([0.0, 0.0, 3.0 * sink + WHEELS.below_nose_m, 20.0, 0.0, -sink])
    x, dt = state.copy(), 0.005
    below = WHEELS.below_nose_m + WHEELS.below_nose_sigma_m * generator.normal()
    while x[2] > below:
        gained = np.sqrt(np.array(psd) * dt) * generator.normal(size=3)
        x[:3] += dt * (x[3:] + 0.5 * gained)
        x[3:] += gained
    return _Straight(state, x[:2])


def test_without_a_plan_constant_velocity_holds_what_it_states() -> None:
    predictor, psd = TouchdownPredictor(replace(SITE, approach=None), WHEELS), ApproachPrior().free_psd_m2_s3
    inside, count = 0, 60
    for seed in range(count):
        flown = _straight(seed, psd)
        off = np.random.default_rng([seed, 4]).normal(size=6) * 0.1
        there = flown.state + off
        found = predictor.forecast(0.0, estimate(there[:3], there[3:], sigmas=np.full(6, 0.1)))
        assert isinstance(found, TouchdownForecast)
        assert found.basis is TouchdownBasis.CONSTANT_VELOCITY
        inside += found.contains(flown.touchdown_m)
    low, high = binom.ppf([0.0005, 0.9995], count, 0.95)
    assert low <= inside <= high


def test_without_a_plan_flares_that_are_stated_are_allowed_for(flights: list[PlannedLanding]) -> None:
    """Expected: of flights that all flare, 95 % are inside 2 s before where that is stated, and fewer where not."""
    inside, before_s = {}, 2.0
    for share in (0.0, 1.0):
        site, prior = replace(SITE, approach=None), ApproachPrior(free_flare_share=share)
        found = _foretold(TouchdownPredictor(site, WHEELS, prior, _SAMPLES), flights, before_s, SIGMAS)
        told = [(f, flown) for f, flown in zip(found, flights, strict=True) if f is not None]
        inside[share] = sum(f.contains(flown.touchdown_m) for f, flown in told)
        if share:
            assert len(told) >= _FLIGHTS - 4
            low, high = binom.ppf([0.0005, 0.9995], len(told), 0.95)
            assert low <= inside[share] <= high
    assert inside[0.0] < inside[1.0]


def test_a_share_of_flares_is_one() -> None:
    with pytest.raises(InputError, match="free_flare_share"):
        ApproachPrior(free_flare_share=1.5)


def test_an_aircraft_that_does_not_fly_the_plan_is_foretold_without_it(predictor: TouchdownPredictor) -> None:
    steep = estimate(np.array([-60.0, 0.0, 14.0]), np.array([SPEED_M_S, 0.0, -4.0]), sigmas=np.full(6, 0.02))
    found = predictor.forecast(0.0, steep)
    assert isinstance(found, TouchdownForecast)
    assert found.basis is TouchdownBasis.CONSTANT_VELOCITY
    # expected: 13.6 m at 4 m/s, at 20 m/s over ground
    assert found.t_s == pytest.approx(3.4, abs=0.05)
    assert found.point_m[0] == pytest.approx(8.0, abs=1.0)


def test_why_there_is_no_forecast_is_stated(predictor: TouchdownPredictor) -> None:
    assert predictor.forecast(0.0, _on_glide_path(-400.0)) is NoTouchdown.TOO_EARLY
    resting = estimate(np.array([60.0, 0.0, 0.3]), np.array([15.0, 0.0, 0.0]))
    assert predictor.forecast(0.0, resting) is NoTouchdown.ON_GROUND
    climbing = estimate(np.array([0.0, 0.0, 10.0]), np.array([SPEED_M_S, 0.0, 3.0]), sigmas=np.full(6, 0.02))
    assert predictor.forecast(0.0, climbing) is NoTouchdown.NOT_DESCENDING


def test_the_same_estimate_gives_the_same_forecast(predictor: TouchdownPredictor) -> None:
    first, second = (predictor.forecast(1.0, _on_glide_path(-100.0)) for _ in range(2))
    assert isinstance(first, TouchdownForecast)
    assert isinstance(second, TouchdownForecast)
    np.testing.assert_array_equal(first.point_m, second.point_m)
    np.testing.assert_array_equal(first.covariance_m2, second.covariance_m2)


def test_the_outline_is_the_edge_of_the_region(predictor: TouchdownPredictor) -> None:
    found = predictor.forecast(1.0, _on_glide_path(-100.0))
    assert isinstance(found, TouchdownForecast)
    for point in found.outline_m():
        assert found.contains(found.point_m + 0.999 * (point - found.point_m))
        assert not found.contains(found.point_m + 1.001 * (point - found.point_m))
    reach = np.abs(found.outline_m(400) - found.point_m).max(axis=0)
    np.testing.assert_allclose(reach, found.half_axes_m, rtol=1e-3)
    assert found.on_runway == pytest.approx(1.0, abs=0.02)


def test_wheels_behind_the_nose_touch_down_so_much_earlier_on_the_runway() -> None:
    points = []
    for behind_m in (0.0, 0.8):
        wheels = WheelPosition(below_nose_m=0.4, behind_nose_m=behind_m)
        found = TouchdownPredictor(SITE, wheels).forecast(0.0, _on_glide_path(-100.0))
        assert isinstance(found, TouchdownForecast)
        points.append(found.point_m)
    np.testing.assert_allclose(points[0] - points[1], [0.8, 0.0], atol=1e-9)


@given(st.floats(0.05, 5.0), st.floats(0.05, 3.0), st.floats(0.01, 5.0))
def test_the_path_hold_stays_in_its_stationary_state(sigma: float, hold: float, step: float) -> None:
    process = PathHold(sigma_m=sigma, hold_rad_s=hold)
    F, root = process.step(step)
    np.testing.assert_allclose(F @ process.stationary @ F.T + root @ root.T, process.stationary, rtol=1e-6, atol=1e-9)
    # expected: two half steps are one
    half, half_root = process.step(0.5 * step)
    np.testing.assert_allclose(half @ half, F, atol=1e-9)
    np.testing.assert_allclose(
        half @ half_root @ half_root.T @ half.T + half_root @ half_root.T, root @ root.T, atol=1e-8
    )


@pytest.mark.parametrize(
    ("name", "value"), [("vertical_sigma_m", 0.0), ("flare_height_m", math.nan), ("speed_sigma_m_s", -1.0)]
)
def test_a_prior_that_is_none_is_refused_by_the_name_of_its_field(name: str, value: float) -> None:
    with pytest.raises(InputError, match=name):
        replace(ApproachPrior(), **{name: value})


def test_a_landing_without_a_planned_speed_is_not_drawn() -> None:
    with pytest.raises(ScenarioError, match="planned speed"):
        draw_planned_landing(
            np.random.default_rng(0), replace(SITE, approach=None), prior=ApproachPrior(), wheels=WHEELS
        )
