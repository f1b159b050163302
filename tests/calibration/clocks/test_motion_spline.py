"""Factors of the splines' normal equations, also where data do not determine all coefficients."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from calibration.clocks.motion_spline import _BandFactors, _factors


def banded(rng: np.random.Generator, count: int) -> np.ndarray:
    """Rows of two splines of ``count`` coefficients, four neighbours each."""
    rows = np.zeros((3 * count, 2 * count))
    for k, row in enumerate(rows):
        first = int(rng.integers(0, count - 3)) + (count if k % 2 else 0)
        row[first : first + 4] = rng.normal(size=4)
    return np.concatenate([rows, 0.1 * np.eye(2 * count)])


def test_solutions_and_the_inverse_are_those_of_the_full_matrix(rng: np.random.Generator) -> None:
    design = banded(rng, 30)
    normal = design.T @ design
    normal += 1e-12 * normal.diagonal().mean() * np.eye(len(normal))
    factors, right = _BandFactors(csr_matrix(design)), rng.normal(size=60)
    assert factors.solve(right) == pytest.approx(np.linalg.solve(normal, right), rel=1e-6, abs=1e-9)
    assert factors.inverse() == pytest.approx(np.linalg.inv(normal), rel=1e-6, abs=1e-9)


def test_coefficients_without_data_have_factors() -> None:
    """Expected: a matrix that rounding errors make indefinite, with more than rounding errors on its diagonal."""
    band = np.array([[1.0, 1.0 - 1e-11, 1.0], [1.0, 0.0, 0.0]])
    assert np.linalg.eigvalsh(np.array([[1.0, 1.0], [1.0, 1.0 - 1e-11]])).min() < 0.0
    factors = _factors(band)
    assert np.isfinite(factors).all()
    # L of L Lᵀ, the band and what is added
    assert factors[0, 0] * factors[1, 0] == pytest.approx(1.0)
    assert factors[1, 0] ** 2 + factors[0, 1] ** 2 == pytest.approx(1.0, abs=1e-6)
