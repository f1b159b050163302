import numpy as np
import pytest
from scipy.signal import lfilter

from groundstation.arrays import FloatArray
from groundstation.evaluation.correlation import correlated_chi_square, effective_count, lag_one


def series(rng: np.random.Generator, rho: float, count: int) -> FloatArray:
    """Gaussian errors (count, 2) of unit variance whose neighbours correlate by rho."""
    noise = rng.normal(size=(count + 200, 2)) * np.sqrt(1 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], noise, axis=0)[200:])


@pytest.mark.parametrize("rho", [-0.5, 0.0, 0.8])
def test_correlation_of_neighbours_is_found_across_broken_runs(rng: np.random.Generator, rho: float) -> None:
    runs = np.array_split(series(rng, rho, 20_000), 50)
    assert lag_one(runs) == pytest.approx(rho, abs=0.03)


def test_a_constant_error_counts_once() -> None:
    runs = [np.full((100, 2), 1.5)]
    assert lag_one(runs) == pytest.approx(1.0)
    assert effective_count(100, lag_one(runs)) == 1.0


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.9])
def test_bounds_contain_the_mean_of_consistent_errors_at_the_stated_rate(rng: np.random.Generator, rho: float) -> None:
    """95 % of 400 series, two-sided; taken as independent, the most correlated would fail two times in five."""
    inside = 0
    for _ in range(400):
        mean = correlated_chi_square([series(rng, rho, 300)])
        assert mean is not None
        inside += mean.low <= mean.mean <= mean.high
    assert 0.90 < inside / 400 < 0.985


def test_nothing_has_no_mean() -> None:
    assert correlated_chi_square([]) is None
    assert lag_one([np.ones((1, 2))]) == 0.0
    assert effective_count(0, 0.5) == 0.0
