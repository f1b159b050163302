"""Rows or columns of a picture around a place."""

import pytest

from groundstation.detection.window_search import _span


@pytest.mark.parametrize(
    ("centre", "expected"),
    [(50.4, (40, 60)), (3.0, (0, 13)), (-20.0, (0, 10)), (97.0, (87, 100)), (130.0, (90, 100))],
)
def test_it_is_cut_at_the_pictures_ends(centre: float, expected: tuple[int, int]) -> None:
    assert _span(centre, 10, 100) == expected
