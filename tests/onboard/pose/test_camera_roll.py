"""How far the pictures of a table are rolled is said whichever way they are."""

import math

import pytest

from groundstation.onboard.pose.camera_roll import roll_doubt


@pytest.mark.parametrize(
    ("rolls_deg", "words"),
    [
        ((90.0, -90.0, 88.0, -92.0), "4 of 4 pictures have the aircraft rolled by 90 deg"),
        ((90.0, 91.0, 2.0), "2 of 3 pictures have the aircraft rolled by 90 deg"),
        ((179.0, -179.0), "rolled by 179 deg, which no approach is flown with: is y counted upwards"),
        ((-90.0, 90.0), "are x and y exchanged"),
    ],
)
def test_either_sign(rolls_deg: tuple[float, ...], words: str) -> None:
    assert words in roll_doubt([math.radians(roll) for roll in rolls_deg])


def test_an_approach_is_not_doubted() -> None:
    assert roll_doubt([0.1, -0.2, None, 1.6]) == ""
