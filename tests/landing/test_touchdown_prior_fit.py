"""The state conditioned on the plan: between the estimate and the prior, by their covariances."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.landing.threshold_state import ALONG, ALONG_RATE, RIGHT, UP, UP_RATE, ThresholdState
from groundstation.landing.touchdown_prior_fit import PlannedStates, fit_plan
from groundstation.landing_site.approach_prior import ApproachPrior
from groundstation.landing_site.planned_approach import PlannedApproach
from tests.landing.approaches import GLIDE_RAD, SPEED_M_S, WHEELS

_PLAN = PlannedApproach(glide_path_rad=GLIDE_RAD, aim_past_threshold_m=30.0, speed_m_s=SPEED_M_S)
_SLOPE = math.tan(GLIDE_RAD)
_HALF = np.random.default_rng(5).normal(size=(500, 10))
_NORMALS = np.concatenate([_HALF, -_HALF])


def _fitted(mean: list[float], sigma: float | list[float], plan: PlannedApproach = _PLAN) -> PlannedStates:
    covariance = np.diag(np.broadcast_to(np.square(sigma), 6)).astype(np.float64)
    state = ThresholdState(t_s=0.0, mean=np.array(mean), covariance=covariance)
    return fit_plan(state, plan, ApproachPrior(), WHEELS, _NORMALS)


def _on_path(along_m: float) -> list[float]:
    return [along_m, 0.0, _PLAN.height_m(along_m), SPEED_M_S, 0.0, -_SLOPE * SPEED_M_S]


@given(st.floats(-250.0, -60.0), st.floats(-2.0, 2.0), st.floats(-1.0, 1.0))
def test_a_certain_estimate_stays(along: float, right: float, above: float) -> None:
    mean = _on_path(along)
    mean[RIGHT] += right
    mean[UP] += above
    found = _fitted(mean, 1e-5)
    np.testing.assert_allclose(found.states, np.broadcast_to(mean, (1000, 6)), atol=1e-3)


def test_an_estimate_without_worth_leaves_the_prior() -> None:
    """Expected: only the place along the path is kept, and the spread is the stated one, to the scatter of 1000."""
    mean = _on_path(-150.0)
    mean[RIGHT], mean[UP] = 400.0, 300.0
    found = _fitted(mean, [0.01, 1e5, 1e5, 1e5, 1e5, 1e5])
    prior = ApproachPrior()
    off = found.states[:, UP] + _SLOPE * (found.states[:, ALONG] - 30.0)
    for values, sigma in (
        (off, prior.vertical_sigma_m),
        (found.states[:, RIGHT], prior.lateral_sigma_m),
        (found.states[:, ALONG_RATE] - SPEED_M_S, prior.speed_sigma_m_s),
        (found.states[:, UP_RATE] + _SLOPE * found.states[:, ALONG_RATE], prior.vertical_sigma_m * prior.hold_rad_s),
    ):
        assert abs(float(values.mean())) < 0.05 * sigma
        assert float(values.std()) == pytest.approx(sigma, rel=0.1)


def test_near_the_ground_the_sink_tells_which_flare_has_begun() -> None:
    """Expected: with the wheels at 1.2 m, more than the glide's sink speaks against a flare, less for one."""
    shares, before = [], []
    for sink in (1.6, 0.8):
        found = _fitted([0.0, 0.0, WHEELS.below_nose_m + 1.2, 19.5, 0.0, -sink], 0.05)
        shares.append(float(found.weights[found.flaring].sum()))
        before.append(float(found.flaring.mean()))
        assert found.weights.sum() == pytest.approx(1.0)
    assert shares[0] < 0.5 * before[0]
    assert shares[1] > before[1] + 0.02


def test_without_a_planned_speed_the_present_one_is_kept() -> None:
    plan = PlannedApproach(glide_path_rad=GLIDE_RAD, aim_past_threshold_m=30.0)
    mean = _on_path(-150.0)
    mean[ALONG_RATE], mean[UP_RATE] = 25.0, -_SLOPE * 25.0
    found = _fitted(mean, 0.05, plan)
    assert float(found.speed_m_s.mean()) == pytest.approx(25.0, abs=0.02)


def test_what_contradicts_the_plan_has_a_large_misfit() -> None:
    mean = _on_path(-150.0)
    assert _fitted(mean, 0.1).misfit < 1.0
    mean[UP] += 10.0
    # expected: 10 m at 0.7 m and 0.1 m of sigma, squared
    assert _fitted(mean, 0.1).misfit == pytest.approx(100.0 / (0.7**2 + 0.1**2 * (1.0 + _SLOPE**2)), rel=0.05)
