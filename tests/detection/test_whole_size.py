"""The size of the whole target, estimated from window searches that detect more than the detector."""

from types import SimpleNamespace

import numpy as np
import pytest

from groundstation.box import Box
from groundstation.detection.window_search import CLEAR_SCORE
from groundstation.single_camera.target_view import TargetView


def test_it_is_the_first_clear_sight_and_follows_later_ones_slowly() -> None:
    view = TargetView.__new__(TargetView)
    view._config = SimpleNamespace(size_change=2.0)
    target = SimpleNamespace(whole_px=None)
    detection = SimpleNamespace(box=Box(0, 0, 20, 8))
    image = np.zeros((4, 4, 3), np.uint8)

    def look(size_px: float, score: float = CLEAR_SCORE) -> float | None:
        view._whole(target, image, SimpleNamespace(size_px=size_px, score=score), (None, detection))
        return target.whole_px

    # neither clear nor of the size that the detector has seen
    assert look(60.0, score=CLEAR_SCORE - 1.0) is None
    assert look(20.0) == pytest.approx(20.0)
    assert look(25.0) == pytest.approx(21.0)
    # too different to be the whole of the same object
    assert look(60.0) == pytest.approx(21.0)
