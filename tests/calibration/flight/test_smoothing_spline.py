"""A curve as smooth as cross-validation has it: the criterion is the whole matrix's, and its least is found."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_smoothing_spline

from calibration.flight.smoothing_spline import _Criterion, smoothing_penalty, smoothing_spline


def by_the_matrix(t: np.ndarray, y: np.ndarray, penalty: float) -> float:
    """Return Σ (y − f)² / tr(I − A)², A made of the curves of unit samples."""
    n = len(t)
    A = np.column_stack([make_smoothing_spline(t, unit, lam=penalty)(t) for unit in np.eye(n)])
    left = y - A @ y
    return float(left @ left) / (n - np.trace(A)) ** 2


@settings(max_examples=20)
@given(st.integers(5, 25), st.integers(-2, 5), st.integers(0, 2**31))
def test_the_criterion_is_that_of_the_whole_matrix(n: int, decade: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.5, 1.5, n))
    y = rng.normal(size=n)
    assert _Criterion(t, y)(10.0**decade) == pytest.approx(by_the_matrix(t, y, 10.0**decade), rel=1e-5)


@pytest.mark.parametrize("step_s", [0.01, 0.1, 3.0])
def test_noise_is_taken_off_whatever_the_unit_of_time(rng: np.random.Generator, step_s: float) -> None:
    k = np.arange(200)
    path = np.sin(k / 20.0)
    noisy = path + rng.normal(scale=0.1, size=len(k))
    found = smoothing_spline(step_s * k, noisy)(step_s * k)
    assert np.sqrt(np.mean((found - path) ** 2)) < 0.04


def test_no_other_smoothness_is_better(rng: np.random.Generator) -> None:
    t = np.arange(0.0, 10.0, 0.05)
    y = np.cos(t) + rng.normal(scale=0.05, size=len(t))
    criterion, found = _Criterion(t, y), smoothing_penalty(t, y)
    assert criterion(found) < 1.0001 * min(criterion(10.0**d) for d in np.linspace(-9.0, 4.0, 100))


def test_a_straight_line_stays_one() -> None:
    t = np.arange(0.0, 5.0, 0.1)
    np.testing.assert_allclose(smoothing_spline(t, 3.0 - 2.0 * t)(t), 3.0 - 2.0 * t, atol=1e-9)
