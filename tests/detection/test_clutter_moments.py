"""Second moments of the clutter around a target, against the same written out."""

import numpy as np
import pytest

from groundstation.box import Box
from groundstation.detection.background import _FramePart
from groundstation.detection.level_set_input import _clutter_moments


@pytest.mark.parametrize("keep_out", [Box(6, 4, 13, 9), Box(0, 0, 5, 5), Box(20, 10, 31, 17), Box(0, 0, 0, 0)])
@pytest.mark.parametrize("partly", [True, False])
def test_moments_are_those_of_every_second_pixel_outside_the_box(
    rng: np.random.Generator, keep_out: Box[int], partly: bool
) -> None:
    residual = rng.normal(size=(3, 17, 31)).astype(np.float32)
    known = rng.random((17, 31)) < 0.7 if partly else np.ones((17, 31), dtype=bool)
    x0, y0, x1, y1 = keep_out
    outside = np.zeros((17, 31), dtype=bool)
    outside[::2, ::2] = True
    outside[y0:y1, x0 : (x1 + 1) // 2 * 2] = False
    values = np.clip(residual[:, outside], -1.5, 1.5) * known[outside]
    expected = (values.astype(float) @ values.T.astype(float)) / outside.sum()
    found = _clutter_moments(residual, keep_out, 1.5, known if partly else None)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)


def test_an_earlier_part_gives_its_colours_apart_and_its_grey() -> None:
    image = np.random.default_rng(3).integers(0, 255, (5, 7, 3), dtype=np.uint8)
    seen = _FramePart(image=image, corner=(0, 0))
    assert [np.asarray(plane).shape for plane in seen.colour] == [(5, 7)] * 3
    for channel in range(3):
        np.testing.assert_allclose(seen.colour[channel], image[:, :, channel])
    assert seen.grey.shape == (5, 7)
