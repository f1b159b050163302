"""The one sigma that a message states for several axes, against errors that are drawn."""

import numpy as np
import pytest
from scipy.stats import ortho_group

from groundstation.arrays import FloatArray
from groundstation.autopilot.local_frame import GeodeticPosition
from groundstation.autopilot.navigation_state import NavigationState

_DRAWN = 20_000


def _state(covariance: FloatArray) -> NavigationState:
    return NavigationState(
        t_s=0.0,
        position_ned_m=np.zeros(3),
        velocity_ned_m_s=np.array([0.0, 20.0, 1.0]),
        covariance=covariance,
        geodetic=GeodeticPosition(lat_deg=47.3, lon_deg=8.5, height_ellipsoid_m=460.0, height_amsl_m=412.5),
        attitude_wxyz=None,
        stations=2,
    )


@pytest.mark.parametrize("sigmas_m", [(3.0, 0.04, 0.1), (0.3, 0.3, 0.3), (0.2, 0.5, 4.0)])
def test_squared_errors_over_the_sigma_stated_have_the_number_of_axes_for_a_mean(
    sigmas_m: tuple[float, float, float],
) -> None:
    """Expected: as a filter supposes that takes one sigma for north and east, and one for three axes of velocity.

    A squared error about its expectation scatters by √2 of the largest part at most: five sigma of the mean.
    """
    rng = np.random.default_rng(7)
    turn = np.kron(np.eye(2), ortho_group.rvs(3, random_state=rng))
    covariance = turn @ np.diag(np.array([*sigmas_m, *sigmas_m]) ** 2) @ turn.T
    state = _state(covariance)
    errors = rng.multivariate_normal(np.zeros(6), covariance, size=_DRAWN)
    for axes, sigma in ((slice(0, 2), state.horizontal_sigma_m), (slice(3, 6), state.speed_sigma_m_s)):
        squares = np.sum((errors[:, axes] / sigma) ** 2, axis=1)
        count = errors[:, axes].shape[1]
        assert squares.mean() == pytest.approx(count, abs=5.0 * np.sqrt(2.0) * count / np.sqrt(_DRAWN))


def test_the_worst_direction_is_at_most_the_root_of_two_beyond_it() -> None:
    rng = np.random.default_rng(8)
    for angle in rng.uniform(0.0, np.pi, 20):
        along = np.array([np.cos(angle), np.sin(angle)])
        horizontal = 9.0 * np.outer(along, along) + 1e-6 * np.eye(2)
        covariance = np.diag([1.0] * 6)
        covariance[:2, :2] = horizontal
        state = _state(covariance)
        assert state.worst_horizontal_sigma_m == pytest.approx(3.0, rel=1e-4)
        assert state.horizontal_sigma_m == pytest.approx(3.0 / np.sqrt(2.0), rel=1e-4)
