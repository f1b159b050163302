"""Recorded windows of a picture: windows are merged if this adds no pixels."""

from groundstation.box import Box
from groundstation.recording.window_merging import _joined


def test_windows_are_joined_where_one_around_them_is_no_larger() -> None:
    # side by side: what is around both is just both
    assert _joined([Box(0, 0, 10, 10)], Box(10, 0, 20, 10)) == [Box(0, 0, 20, 10)]
    # apart: what is around both is larger
    assert _joined([Box(0, 0, 10, 10)], Box(11, 0, 21, 10)) == [Box(0, 0, 10, 10), Box(11, 0, 21, 10)]
    # overlapping a little at a corner: the same
    assert _joined([Box(0, 0, 10, 10)], Box(9, 9, 19, 19)) == [Box(0, 0, 10, 10), Box(9, 9, 19, 19)]
    # one more joins two that were apart
    assert _joined([Box(0, 0, 10, 10), Box(20, 0, 30, 10)], Box(10, 0, 20, 10)) == [Box(0, 0, 30, 10)]
