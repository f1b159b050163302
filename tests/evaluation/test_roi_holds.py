"""Whether a region of interest holds a silhouette's pixels."""

import pytest

from groundstation.box import Box
from groundstation.experiments.detector_outcomes import _holds


@pytest.mark.parametrize(
    ("x", "y", "right", "down", "held"),
    [
        *((9.5, 19.5, 30.0, 40.0, True), (9.4, 19.5, 30.0, 40.0, False), (9.5, 19.4, 30.0, 40.0, False)),
        *((9.5, 19.5, 30.1, 40.0, False), (9.5, 19.5, 30.0, 40.1, False), (30.0, 50.0, 2.0, 2.0, True)),
    ],
)
def test_all_of_its_pixels_lie_inside(x: float, y: float, right: float, down: float, held: bool) -> None:
    assert _holds(Box(10, 20, 40, 60), x, y, right, down) is held
