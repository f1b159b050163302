"""The detected point's error on the aircraft, in the covariance of an estimate."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.estimation.target_point import TargetPointError, with_point_error
from groundstation.messages import Kinematics

SIGMA_M = np.array([0.5, 0.1, 0.2])


def estimate(velocity_m_s: np.ndarray, velocity_sigma_m_s: float) -> Kinematics:
    covariance = np.diag([0.01, 0.04, 0.02, *[velocity_sigma_m_s**2] * 3])
    return Kinematics(position_runway_m=np.zeros(3), velocity_runway_m_s=velocity_m_s, covariance=covariance)


def test_error_lies_along_the_path() -> None:
    found = with_point_error(estimate(np.array([0.0, -25.0, -1.0]), 0.0), SIGMA_M)
    added = found.covariance - estimate(np.zeros(3), 0.0).covariance
    np.testing.assert_allclose(added[:3, :3], np.diag([0.1**2, 0.5**2, 0.2**2]), atol=1e-12)
    assert not added[3:].any()
    assert not added[:, 3:].any()


def test_error_of_a_standing_aircraft_counts_in_every_direction() -> None:
    found = with_point_error(estimate(np.zeros(3), 1.0), SIGMA_M)
    added = np.diag(found.covariance)[:3] - [0.01, 0.04, 0.02]
    np.testing.assert_allclose(added, [(0.5**2 + 0.1**2) / 2] * 2 + [0.2**2])


@given(
    st.tuples(*[st.floats(-60, 60)] * 3),
    st.floats(0, 20),
    st.tuples(*[st.floats(0, 3)] * 3),
)
def test_covariance_only_grows(velocity: tuple[float, ...], sigma: float, point: tuple[float, ...]) -> None:
    before = estimate(np.array(velocity), sigma)
    after = with_point_error(before, np.array(point))
    added = after.covariance - before.covariance
    assert np.linalg.eigvalsh(added).min() >= -1e-9
    np.testing.assert_allclose(np.trace(added), float(np.square(point).sum()), atol=1e-9)


EYES_M = [np.array([-8.0, 0.0, 1.5]), np.array([8.0, 0.0, 1.5])]
SPAN_M = 2.0
HIDDEN = TargetPointError(
    sigma_spans=SIGMA_M / SPAN_M,
    hidden_lead_spans=0.2,
    hidden_spans=np.array([0.25, 0.0, 0.03]),
    eyes_m=EYES_M,
)


def far_away(velocity_m_s: np.ndarray, velocity_sigma_m_s: float = 0.0) -> Kinematics:
    """Return an estimate on the runway's axis, at the cameras' height, 4 km from them."""
    return replace(estimate(velocity_m_s, velocity_sigma_m_s), position_runway_m=np.array([0.0, 4000.0, 1.5]))


@given(st.floats(-np.pi, np.pi))
def test_a_nose_that_is_hidden_is_ahead_and_less_certain(course_rad: float) -> None:
    """Expected: towards the cameras and across nothing; away a lead along the path, and the sum of variances."""
    path = np.array([np.sin(course_rad), np.cos(course_rad), 0.0])
    before = far_away(20.0 * path)
    found = HIDDEN.corrected(before, SPAN_M)
    away = max(np.cos(course_rad), 0.0)
    moved = found.position_runway_m - before.position_runway_m
    np.testing.assert_allclose(moved, SPAN_M * 0.2 * away**2 * path, atol=1e-3)
    sigma_m = np.array([np.hypot(0.5, 0.5 * away), SIGMA_M[1], np.hypot(SIGMA_M[2], 0.06 * away)])
    np.testing.assert_allclose(found.covariance, with_point_error(before, sigma_m).covariance, rtol=1e-3, atol=1e-6)
    np.testing.assert_array_equal(found.velocity_runway_m_s, before.velocity_runway_m_s)


def test_a_climbing_aircraft_has_its_hidden_nose_along_the_climb() -> None:
    before = far_away(np.array([0.0, 20.0, 5.0]))
    moved = HIDDEN.corrected(before, SPAN_M).position_runway_m - before.position_runway_m
    assert moved[2] == pytest.approx(0.25 * moved[1])
    assert np.linalg.norm(moved) == pytest.approx(SPAN_M * 0.2 * 400.0 / 425.0, rel=1e-3)


@given(st.floats(0.1, 30.0), st.floats(0.0, 30.0))
def test_the_lead_is_the_shorter_the_less_the_direction_is_known(speed: float, sigma: float) -> None:
    """Expected: v / √(v² + 3 σ²) of it, which goes to nothing for an aircraft that stands."""
    before = far_away(np.array([0.0, speed, 0.0]), sigma)
    moved = HIDDEN.corrected(before, SPAN_M).position_runway_m - before.position_runway_m
    share = speed / np.sqrt(speed**2 + 3.0 * sigma**2)
    np.testing.assert_allclose(moved, [0.0, SPAN_M * 0.2 * share, 0.0], rtol=1e-3, atol=1e-9)


def test_an_aircraft_that_stands_has_no_direction_to_be_hidden_in() -> None:
    before = far_away(np.zeros(3), 1.0)
    found = HIDDEN.corrected(before, SPAN_M)
    np.testing.assert_array_equal(found.position_runway_m, before.position_runway_m)
    np.testing.assert_allclose(found.covariance, with_point_error(before, SIGMA_M).covariance)
