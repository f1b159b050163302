"""The middle of an image, where a turning station keeps the aircraft."""

from types import SimpleNamespace

import numpy as np

from calibration.lens.advice import middle_angle_deg


def test_the_middle_is_without_a_fifth_on_each_side() -> None:
    angles = np.full((10, 20), 9.0)
    angles[2:8, 4:16] = 1.0
    angles[5, 7] = 2.0
    assert middle_angle_deg(SimpleNamespace(map=SimpleNamespace(aligned_deg=angles))) == 2.0
    angles[2, 4] = 3.0
    assert middle_angle_deg(SimpleNamespace(map=SimpleNamespace(aligned_deg=angles))) == 3.0
