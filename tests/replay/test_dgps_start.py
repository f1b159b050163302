"""A start from DGPS: the nose at session time, by what is known of the receiver's clock and antenna."""

import numpy as np
import pytest

from groundstation.errors import SessionError
from groundstation.estimation.parameters import ParameterPrior
from groundstation.messages import DgpsFix
from groundstation.replay.initial_state import start_from_dgps
from groundstation.replay.reference_prior import ReferencePrior

SPEED_M_S = 40.0
LATE_S = 5.0
# the antenna of an aircraft that flies along -y, level
ANTENNA_M = np.array([-1.5, 0.4, -0.3])
LOG = tuple(
    DgpsFix(
        t_s=t_s + LATE_S,
        position_runway_m=np.array([0.0, 800.0 - SPEED_M_S * t_s, 20.0]) + np.array([-0.4, 1.5, 0.3]),
        sigma_m=np.full(3, 0.02),
    )
    for t_s in np.arange(-8.0, 15.0, 0.1).round(6).tolist()
)


def known(offset_s: float, sigma_s: float | None, antenna_m: np.ndarray | None = ANTENNA_M) -> ReferencePrior:
    return ReferencePrior(
        offset_s=offset_s,
        offset_sigma_s=sigma_s,
        antenna_in_body_m=antenna_m,
        errors=ParameterPrior.nothing(),
        notes=(),
    )


def test_it_is_where_the_nose_was_at_session_time() -> None:
    """Expected: 760 m at 1 s; with the log's own times it was 960 m, 15 sigmas off."""
    start = start_from_dgps(LOG, known(LATE_S, 0.01), 1.0, "flight")
    assert start.t_s == pytest.approx(1.0)
    np.testing.assert_allclose(start.position_runway_m, [0.0, 760.0, 20.0], atol=1e-6)
    np.testing.assert_allclose(start.velocity_runway_m_s, [0.0, -SPEED_M_S, 0.0], atol=1e-6)
    # the rig's sigma of the clock, and a metre
    np.testing.assert_allclose(start.sigma_position_m, [1.0, 1.0 + 0.01 * SPEED_M_S, 1.0], atol=1e-6)


def test_an_unknown_clock_is_in_the_sigma() -> None:
    start = start_from_dgps(LOG, known(0.0, None, None), 6.0, "flight")
    np.testing.assert_allclose(start.position_runway_m, [-0.4, 761.5, 20.3], atol=1e-6)
    np.testing.assert_allclose(start.sigma_position_m, [1.0, 1.0 + 0.5 * SPEED_M_S, 1.0], atol=1e-6)


def test_a_log_that_by_its_clock_is_of_another_time_is_refused() -> None:
    with pytest.raises(SessionError, match="0 fixes in the first second"):
        start_from_dgps(LOG, known(-60.0, 0.01), 1.0, "flight")
