"""Mean membership of a row's middle; and what was known of a target before it was doubted."""

import numpy as np
import pytest

from groundstation.detection.fuselage import _core
from groundstation.single_camera.pixel_identity import TargetAppearance


def test_the_mean_is_over_the_row_within_its_ends() -> None:
    level = np.zeros((3, 12), np.float32)
    level[1] = np.arange(12)
    assert _core(level, 1, 8.0, 2.0) == pytest.approx(8.0)
    assert _core(level, 1, 11.0, 2.0) == pytest.approx(10.0)
    assert _core(level, 1, 0.0, 1.0) == pytest.approx(0.5)


def test_what_was_known_before_a_doubt_is_the_oldest_that_is_kept() -> None:
    identity = TargetAppearance()
    identity._known = ["long ago", "lately"]
    identity.calm, identity.other = 5, object()
    assert identity.doubt(3.0) == "long ago"
    assert (identity.doubt_s, identity.calm, identity.other) == (3.0, 0, None)
