"""Errors, bins, phases and the χ² means, on numbers worked out by hand."""

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.evaluation.metrics import (
    Comparison,
    accuracy,
    chi_square_mean,
    in_bin,
    phase_masks,
    range_bins,
    statistics,
)
from tests.evaluation.synthetic import Phase


def _comparison(ekf: np.ndarray, triangulation: np.ndarray, ekf_known: list[bool], both: list[bool]) -> Comparison:
    n = len(ekf)
    return Comparison(
        t_s=np.arange(n, dtype=float),
        reference_m=np.zeros((n, 3)),
        usable=np.ones(n, dtype=bool),
        ekf_error_m=ekf,
        ekf_known=np.array(ekf_known),
        triangulation_error_m=triangulation,
        triangulation_known=np.array(both),
        covariance_m2=np.tile(4.0 * np.eye(3), (n, 1, 1)),
    )


def test_statistics_of_known_errors() -> None:
    found = statistics(np.array([[3.0, 0.0, -1.0], [-4.0, 0.0, -1.0]]))
    assert found is not None
    np.testing.assert_allclose(found.rmse_m, [np.sqrt(12.5), 0.0, 1.0])
    np.testing.assert_allclose(found.mean_m, [-0.5, 0.0, -1.0])
    np.testing.assert_allclose(found.max_m, [4.0, 0.0, 1.0])
    np.testing.assert_allclose(found.p95_m, [3.95, 0.0, 1.0])
    assert statistics(np.zeros((0, 3))) is None


def test_improvement_uses_common_epochs_only() -> None:
    """Expected: the EKF's bad epoch without triangulation counts for the EKF alone, not for the improvement."""
    ekf = np.array([[1.0] * 3, [1.0] * 3, [50.0] * 3])
    triangulation = np.array([[2.0] * 3, [2.0] * 3, [0.0] * 3])
    found = accuracy(_comparison(ekf, triangulation, [True] * 3, [True, True, False]), np.ones(3, dtype=bool))
    assert found.common_ekf is not None
    assert found.common_ekf.count == 2
    assert found.ekf is not None
    assert found.ekf.count == 3
    np.testing.assert_allclose(found.improvement_percent, [50.0] * 3)


def test_nothing_in_common_is_no_improvement() -> None:
    c = _comparison(np.ones((2, 3)), np.ones((2, 3)), [True, False], [False, True])
    assert accuracy(c, np.ones(2, dtype=bool)).improvement_percent is None


def test_nees_is_the_squared_error_in_sigmas() -> None:
    c = _comparison(np.full((2, 3), 2.0), np.zeros((2, 3)), [True, False], [False, False])
    np.testing.assert_allclose(c.nees(), [3.0])


def test_range_bins_are_half_open_and_the_last_has_no_end() -> None:
    bins = range_bins((0.0, 60.0, 100.0))
    assert bins == [(0.0, 60.0), (60.0, 100.0), (100.0, np.inf)]
    y = np.array([-1.0, 0.0, 59.9, 60.0, 100.0, 5000.0])
    counted = [in_bin(y, low, high) for low, high in bins]
    np.testing.assert_array_equal(np.sum(counted, axis=0), [0, 1, 1, 1, 1, 1])


def test_phases_of_one_background_go_together() -> None:
    masks = phase_masks(
        np.array([0.0, 1.0, 2.0, 3.0]),
        [
            Phase(from_s=0.0, to_s=0.5, background="sky"),
            Phase(from_s=0.9, to_s=1.1, background="ground"),
            Phase(from_s=3.0, to_s=9.0, background="sky"),
        ],
    )
    np.testing.assert_array_equal(masks["sky"], [True, False, False, True])
    np.testing.assert_array_equal(masks["ground"], [False, True, False, False])


def test_chi_square_bounds_hold_95_percent_of_the_time(rng: np.random.Generator) -> None:
    n, inside, runs = 200, 0, 400
    for _ in range(runs):
        found = chi_square_mean(rng.chisquare(3, size=n), np.full(n, 3.0))
        assert found is not None
        inside += found.low <= found.mean <= found.high
    assert found.low == pytest.approx(chi2.ppf(0.025, 3 * n) / (3 * n))
    assert 0.92 < inside / runs < 0.98
    assert chi_square_mean(np.zeros(0), np.zeros(0)) is None
