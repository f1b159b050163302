"""Quantiles of χ² are those of `scipy.stats`, to the last bit."""

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.geometry.chi_square import chi_square_limit, chi_square_quantile


def test_they_are_those_of_scipys_distribution(rng: np.random.Generator) -> None:
    probability, dof = rng.uniform(size=1000), rng.integers(1, 3000, 1000)
    assert np.array_equal(chi_square_quantile(probability, dof), chi2.ppf(probability, dof))
    assert np.array_equal(chi_square_limit(probability, dof), chi2.isf(probability, dof))


@pytest.mark.parametrize("chance", [0.0, 1e-300, 1e-12, 0.5, 1.0])
@pytest.mark.parametrize("dof", [1, 2, 2.5, 1e6])
def test_ends_and_tails_are_as_well(chance: float, dof: float) -> None:
    assert chi_square_quantile(chance, dof) == chi2.ppf(chance, dof)
    assert chi_square_limit(chance, dof) == chi2.isf(chance, dof)


def test_a_quantile_and_its_limit_are_two_sides_of_one() -> None:
    assert chi_square_quantile([0.025, 0.975], 6) == pytest.approx([chi_square_limit(p, 6) for p in (0.975, 0.025)])
