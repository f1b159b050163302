"""The gusts' equation of motion, as its docstring has it."""

import numpy as np
import pytest

from groundstation.simulation.path_deviation import GustModel


def test_the_dynamics_are_those_of_the_docstring() -> None:
    gusts = GustModel(correlation_s=2.0, hold_rad_s=0.6, damping=0.7)
    expected = [[0.0, 1.0, 0.0], [-0.36, -0.84, 1.0], [0.0, 0.0, -0.5]]
    np.testing.assert_allclose(gusts._dynamics(), expected, rtol=1e-12)
    A, P = np.array(expected), gusts.stationary_covariance
    np.testing.assert_allclose(A @ P + P @ A.T, -np.diag([0.0, 0.0, 1.0]), atol=1e-12)
    assert P[2, 2] == pytest.approx(1.0)
