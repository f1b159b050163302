"""The baseline's start: the true box, never too flat for OpenCV's CSRT."""

import numpy as np

from groundstation.bank.baseline import LEAST_BOX_PX, start_box
from groundstation.box import Box
from groundstation.sources.true_silhouettes import TrueSilhouette


def test_the_tracker_starts_in_the_true_box() -> None:
    mask = np.zeros((20, 40), dtype=bool)
    mask[3:15, 5:35] = True
    assert start_box(TrueSilhouette(x=100, y=50, mask=mask)) == Box(105.0, 53.0, 135.0, 65.0)


def test_a_flat_silhouette_gives_a_box_of_the_least_height_about_its_middle() -> None:
    box = start_box(TrueSilhouette(x=10, y=20, mask=np.ones((2, 30), dtype=bool)))
    assert (box.x0, box.x1) == (10.0, 40.0)
    assert box.h == LEAST_BOX_PX
    assert 0.5 * (box.y0 + box.y1) == 21.0
