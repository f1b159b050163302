"""Fragments of one object are merged, as long as that does not enlarge it too much."""

import pytest

from groundstation.box import Box
from groundstation.detection.spot_detection import CandidateRegion, joined


def spot(x0: float, x1: float, mass: float) -> CandidateRegion:
    return CandidateRegion(box=Box(x0, 0.0, x1, 4.0), centre=(0.5 * (x0 + x1), 2.0), contrast=mass, mass=mass)


@pytest.mark.parametrize(
    ("x0", "x1", "pieces"),
    [
        # near, and together at most twice as long
        (12.0, 20.0, 1),
        # near, and together more than that
        (12.0, 21.0, 2),
        # too far
        (16.0, 20.0, 2),
    ],
)
def test_near_ones_are_joined_up_to_the_growth(x0: float, x1: float, pieces: int) -> None:
    found = joined([spot(0.0, 10.0, 9.0), spot(x0, x1, 1.0)], reach=0.5, least_px=1.0, growth=2.0)
    assert len(found) == pieces
    assert found[0].mass == (10.0 if pieces == 1 else 9.0)
