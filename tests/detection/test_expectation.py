"""Where in the working image a target may be."""

from types import SimpleNamespace

import numpy as np
import pytest

from groundstation.box import Box
from groundstation.detection.working_image import _LENGTH_PER_SPAN, expectation


def box(forward: tuple[float, float] | None) -> Box[int]:
    look = SimpleNamespace(
        image=np.zeros((200, 300, 3), np.uint8),
        span=20.0,
        forward=None if forward is None else np.array(forward),
        predicted=np.array([150.0, 100.0]),
        covariance=np.diag([4.0, 4.0]),
    )
    return expectation(look).box


def test_the_tail_trails_behind_the_nose() -> None:
    plain = box(None)
    assert plain == pytest.approx((130, 87, 171, 114), abs=1)
    tail = _LENGTH_PER_SPAN * 20.0
    assert box((1.0, 0.0)) == pytest.approx((plain[0] - tail, plain[1], plain[2], plain[3]), abs=1)
    assert box((-1.0, 0.0)) == pytest.approx((plain[0], plain[1], plain[2] + tail, plain[3]), abs=1)
    assert box((0.0, -0.5)) == pytest.approx((plain[0], plain[1], plain[2], plain[3] + 0.5 * tail), abs=1)
