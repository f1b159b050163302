"""Curves through a head's readings, from gap to gap; and what a fit states of its parameters together."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.flight.fit import FlightFit
from calibration.flight.observations import _curves


def test_each_curve_reaches_from_one_gap_to_the_next() -> None:
    t_s = np.concatenate([np.arange(0.0, 4.0, 0.05), np.arange(10.0, 13.0, 0.05)])
    angles = np.column_stack([0.1 * t_s, np.sin(0.3 * t_s)])
    first, second = _curves(t_s, angles)
    assert (first.from_s, first.to_s) == pytest.approx((0.0, 3.95))
    assert (second.from_s, second.to_s) == pytest.approx((10.0, 12.95))
    assert first.axes[0](2.02) == pytest.approx(0.202, abs=1e-6)
    assert second.axes[1](11.02) == pytest.approx(np.sin(0.3 * 11.02), abs=1e-4)
    assert _curves(t_s[:3], angles[:3]) == ()


def test_correlations_have_ones_on_the_diagonal() -> None:
    covariance = np.array([[4.0, -3.0], [-3.0, 9.0]])
    fit = SimpleNamespace(covariance=covariance, sigma=np.array([2.0, 3.0]))
    np.testing.assert_allclose(FlightFit.correlation.fget(fit), [[1.0, -0.5], [-0.5, 1.0]])
