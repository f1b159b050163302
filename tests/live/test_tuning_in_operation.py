"""What is set for cameras that run at a known rate."""

from dataclasses import replace

import pytest

from groundstation.live.core import live_config
from groundstation.tracking.config import Config


def test_half_a_period_is_not_waited_for_unless_something_else_is_given() -> None:
    plain = Config()
    assert plain.synchronise.camera_gap_s == 0.0
    assert live_config(plain, 25.0).synchronise.camera_gap_s == pytest.approx(0.02)
    given = replace(plain, synchronise=replace(plain.synchronise, camera_gap_s=0.007))
    assert live_config(given, 25.0) == given
