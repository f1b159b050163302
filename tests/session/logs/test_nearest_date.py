"""The date that a time of day belongs to: the nearer one on the clock, also across midnight."""

import pytest

from groundstation.session.logs.nmea import _nearest

BEFORE, AFTER = (100, 86_390.0), (101, 10.0)


@pytest.mark.parametrize(("second", "expected"), [(86_395.0, BEFORE), (5.0, AFTER), (86_300.0, BEFORE), (100.0, AFTER)])
def test_the_nearer_date_is_taken(second: float, expected: tuple[int, float]) -> None:
    assert _nearest([BEFORE, AFTER], 1, second) == expected


def test_before_the_first_and_after_the_last_there_is_one() -> None:
    assert _nearest([BEFORE, AFTER], 0, 5.0) == BEFORE
    assert _nearest([BEFORE, AFTER], 2, 86_395.0) == AFTER
