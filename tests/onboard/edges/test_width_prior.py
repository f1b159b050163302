"""What follows for a pair of lines from the width that was announced."""

import numpy as np
import pytest

from groundstation.onboard.edges.width_prior import WidthPrior, other_pair_m2, other_pair_probability, width_density


def announced(width_m: float, scale_sigma: float = 0.0) -> WidthPrior:
    return WidthPrior(announced_m=width_m, scale_sigma=scale_sigma)


def test_the_announced_width_counts_with_its_tolerance() -> None:
    assert width_density(20.0, announced(20.0)) == 0.0
    narrow = [width_density(w, announced(20.0)) for w in (19.8, 19.0, 15.0)]
    assert narrow == sorted(narrow, reverse=True)
    assert narrow[0] > -0.2
    # announced wrong by a quarter is no more than unlikely
    assert -5.0 < narrow[2] < -2.0
    # a height that may be wrong by a tenth leaves the width open
    assert width_density(19.0, announced(20.0, 0.1)) > -0.3


@pytest.mark.parametrize("factors", [(1.0, 1.1, 1.25, 1.4, 1.9), (1.0, 0.9, 0.75, 0.65, 0.45)])
def test_a_pair_is_the_likelier_another_one_the_more_its_width_differs(factors: tuple[float, ...]) -> None:
    found = [other_pair_probability(30.0 * factor, announced(30.0)) for factor in factors]
    assert found == sorted(found)
    assert found[0] < 0.01
    assert 0.03 < found[2] < 0.3
    assert found[-1] > 0.9
    assert other_pair_probability(30.0 * factors[0] * 3.0, announced(30.0)) == 1.0


def test_the_height_s_part_of_a_width_makes_no_other_pair_of_it() -> None:
    assert other_pair_probability(33.0, announced(30.0, 0.1)) < 0.3 * other_pair_probability(33.0, announced(30.0))


@pytest.mark.parametrize(("width_m", "announced_m"), [(41.0, 31.0), (20.0, 30.0)])
def test_edges_as_wide_as_announced_are_within_three_sigmas_of_another_pair_s(
    width_m: float, announced_m: float
) -> None:
    """Shoulders at both sides, and paint or rubber within; an apron at one side alone is within five."""
    moment, off_m = other_pair_m2(width_m, announced(announced_m)), abs(width_m - announced_m)
    for off, most in ((np.array([0.5, 0.5]), 3.0), (np.array([1.0, 0.0]), 5.0)):
        assert (off_m * off <= most * np.sqrt(moment.diagonal())).all()
        assert off_m**2 * off @ np.linalg.solve(moment, off) <= most**2


def test_a_pair_of_the_announced_width_has_nothing_to_add() -> None:
    assert other_pair_m2(30.0, announced(30.0)) == pytest.approx(np.zeros((2, 2)))
    assert np.sqrt(other_pair_m2(30.3, announced(30.0)).diagonal()).max() < 0.02
