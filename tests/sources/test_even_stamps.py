"""Whether a container's stamps are even."""

import pytest

from groundstation.sources.video_seek import _even


@pytest.mark.parametrize(
    ("stamps_ms", "even"),
    [
        *(([0.0, 33.0, 67.0, 100.0], True), ([0.0, 40.0, 67.0, 100.0], True), ([0.0, 50.0, 67.0, 100.0], False)),
        # no time at all between them, and a clock that runs back
        *(([0.0, 0.0, 0.0], False), ([0.0, -33.0, -67.0], False)),
    ],
)
def test_stamps_are_even_but_for_rounding(stamps_ms: list[float], even: bool) -> None:
    assert _even(stamps_ms) is even
