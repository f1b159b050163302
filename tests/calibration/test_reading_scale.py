"""A scale or a roll that no head has is told, with the unit that explains it."""

import numpy as np
import pytest

from calibration.reading_scale import roll_doubt, scale_doubt


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (-0.09956, "0.9004 times the readings"),
        (-0.099991, "are the readings in gradians?"),
        (float(np.degrees(1.0)) - 1.0, "are the readings in radians?"),
        (-0.49908, "is the focal length right, and are the readings in degrees?"),
        (0.084, "is the focal length right"),
    ],
)
def test_scales_that_no_head_has_are_told(scale: float, words: str) -> None:
    assert words in scale_doubt(scale)


@pytest.mark.parametrize("scale", [0.0, 0.005, -0.01, 0.02])
def test_usual_scales_are_not(scale: float) -> None:
    assert scale_doubt(scale) == ""


def test_a_roll_as_of_exchanged_axes_is_told() -> None:
    assert "rolled by -13.5 deg" in roll_doubt(-13.5)
    assert roll_doubt(-0.7) == roll_doubt(3.0) == ""
