"""The detected point's error on the aircraft, in the covariance of an estimate."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from groundstation.estimation.target_point import with_point_error
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
