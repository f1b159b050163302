"""When a target counts as lost, and how fast what is seen several times is taken to move."""

from types import SimpleNamespace

import pytest

from groundstation.detection.target_confirmation import _VELOCITY_GAIN, _advance, _TentativeTarget
from groundstation.single_camera.pixel_tracker import _LEAST_MISSES, PixelTracker


@pytest.mark.parametrize(
    ("unseen_s", "misses", "lost"),
    [(1.1, _LEAST_MISSES, True), (1.1, _LEAST_MISSES - 1, False), (1.0, _LEAST_MISSES, False)],
)
def test_a_target_is_lost_after_a_time_and_so_many_misses(unseen_s: float, misses: int, lost: bool) -> None:
    tracker = PixelTracker.__new__(PixelTracker)
    tracker._config = SimpleNamespace(lost_after_s=1.0)
    assert tracker._is_lost(SimpleNamespace(seen_s=0.0, misses=misses), unseen_s) is lost


def test_the_second_sight_gives_the_velocity_and_later_ones_correct_it() -> None:
    def sight(u_px: float) -> SimpleNamespace:
        return SimpleNamespace(u_px=u_px, v_px=0.0)

    tentative = _TentativeTarget(newest=sight(0.0), first_s=0.0, newest_s=0.0)
    _advance(tentative, sight(10.0), 0.5, 1.0)
    assert tentative.velocity_px_s == pytest.approx((20.0, 0.0))
    _advance(tentative, sight(25.0), 1.0, 1.0)
    # 5 px farther than where it was led to
    assert tentative.velocity_px_s == pytest.approx((20.0 + _VELOCITY_GAIN * 10.0, 0.0))
    assert (tentative.seen, tentative.missed, len(tentative.scores)) == (3, 0, 2)
