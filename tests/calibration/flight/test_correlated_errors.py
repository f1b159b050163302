"""Inflation of sigmas by time-correlated errors, where there are enough blocks of measurements to estimate it."""

from types import SimpleNamespace

import numpy as np

from calibration.flight.covariance import LEAST_BLOCKS, correlated_error_factor


def factor(parameters: int, blocks: int, times: float) -> np.ndarray:
    seen = np.sqrt(times) * np.ones((blocks, parameters))
    expected = np.tile(np.eye(parameters), (blocks, 1, 1))
    joint = SimpleNamespace(scores=lambda *_: SimpleNamespace(seen=seen, expected=expected))
    return correlated_error_factor(joint, np.zeros(parameters), np.eye(parameters), np.eye(parameters))


def test_half_as_many_blocks_as_parameters_are_needed() -> None:
    parameters = 2 * LEAST_BLOCKS + 8
    enough = parameters // 2
    np.testing.assert_array_equal(factor(parameters, enough - 1, 25.0), 1.0)
    np.testing.assert_allclose(factor(parameters, enough, 25.0), 5.0)


def test_a_minimum_number_of_blocks_is_needed_and_chance_has_no_effect() -> None:
    np.testing.assert_array_equal(factor(2, LEAST_BLOCKS - 1, 25.0), 1.0)
    np.testing.assert_allclose(factor(2, LEAST_BLOCKS, 25.0), 5.0)
    np.testing.assert_array_equal(factor(2, LEAST_BLOCKS, 1.2), 1.0)
