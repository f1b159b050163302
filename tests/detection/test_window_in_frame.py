"""Whether a window between pixels lies in a frame."""

import pytest

from groundstation.detection.background import _holds


@pytest.mark.parametrize(
    ("offset", "held"),
    [
        *(((0.0, 0.0), True), ((0.5, 0.0), True), ((-0.1, 0.0), False), ((0.0, -0.1), False)),
        # between pixels the next one is needed too
        *(((5.9, 3.9), True), ((6.0, 3.0), False), ((5.0, 4.0), False)),
    ],
)
def test_a_window_lies_in_the_frame(offset: tuple[float, float], held: bool) -> None:
    assert _holds((10, 20, 3), offset, (14, 6)) is held
