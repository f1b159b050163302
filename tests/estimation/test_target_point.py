"""The detected point's error on the aircraft, in the covariance of an estimate."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from groundstation.estimation.target_point import point_sigma_m, with_point_error
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


@given(st.floats(-np.pi, np.pi))
def test_a_nose_that_is_hidden_is_less_certain_along_the_aircraft_and_upward(course_rad: float) -> None:
    """Expected: towards the cameras the sigma as it is, away the root of the squares' sum, in between in between."""
    velocity = 20.0 * np.array([np.sin(course_rad), np.cos(course_rad), 0.0])
    flying = Kinematics(
        position_runway_m=np.array([0.0, 4000.0, 1.5]), velocity_runway_m_s=velocity, covariance=np.eye(6)
    )
    behind = np.array([0.25, 0.0, 0.03])
    sigma = point_sigma_m(flying, 2.0, SIGMA_M / 2.0, behind, EYES_M)
    away = max(np.cos(course_rad), 0.0)
    wanted = [np.hypot(0.5, 0.5 * away), SIGMA_M[1], np.hypot(SIGMA_M[2], 0.06 * away)]
    np.testing.assert_allclose(sigma, wanted, rtol=1e-3)
    standing = point_sigma_m(estimate(np.zeros(3), 1.0), 2.0, SIGMA_M / 2.0, behind, EYES_M)
    np.testing.assert_allclose(standing, SIGMA_M)
