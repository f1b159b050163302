"""The part of a picture in which all that was seen lies."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.flight.report_pictures import _seen_part


def part(pixel_px: list[tuple[float, float]]) -> tuple[float, float, float, float]:
    pixel = np.array(pixel_px, float).reshape(-1, 2)
    observed = SimpleNamespace(pixel_px=pixel)
    fit = SimpleNamespace(
        problem=SimpleNamespace(observations={"left": observed}),
        stations={"left": SimpleNamespace(kept=np.ones(len(pixel), dtype=bool))},
    )
    lens = SimpleNamespace(image_size_px=(640, 480))
    return _seen_part(SimpleNamespace(after={"left": SimpleNamespace(lens=lens)}, fit=fit), "left")


def test_a_small_part_is_shown_about_its_middle() -> None:
    left, right, top, bottom = part([(300.0, 200.0), (340.0, 260.0), (310.0, 210.0)])
    assert (left + right, top + bottom) == pytest.approx((640.0, 460.0))
    assert (right - left, bottom - top) == pytest.approx((78.0, 78.0))


def test_a_large_one_and_none_show_the_whole_picture() -> None:
    whole = (-0.5, 639.5, -0.5, 479.5)
    assert part([]) == whole
    assert part([(10.0, 10.0), (400.0, 20.0)]) == whole
