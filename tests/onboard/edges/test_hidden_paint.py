"""Which ground may hide white paint: by colours and by the paint that a picture shows, not by its grey levels."""

import numpy as np
import pytest

from groundstation.onboard.edges.hidden_paint import PaintSight, whiteness

ASPHALT, CONCRETE = np.array([0.45, 0.45, 0.46]), np.array([0.7, 0.69, 0.67])
# blue, green, red of a picture
SNOW, SAND, BLEACHED, PAINT = (
    np.array(c) for c in ((0.90, 0.89, 0.87), (0.59, 0.70, 0.77), (0.6, 0.74, 0.76), (0.93,) * 3)
)
ROWS, CROSSINGS = np.array([100.0, 180.0]), np.array([120.0, 60.0, 200.0, 260.0])


@pytest.mark.parametrize("exposure", [1.0, 0.55, 0.3])
@pytest.mark.parametrize("pavement", [ASPHALT, CONCRETE])
def test_snow_is_as_white_at_any_exposure_and_sand_at_none(pavement: np.ndarray, exposure: float) -> None:
    """The same snow at 55 % of the exposure was not white, and its sigma half as large."""

    def white(ground: np.ndarray, paint: float | None) -> float:
        return whiteness(exposure * np.array([pavement, ground]), None if paint is None else exposure * paint)

    paint = float(PAINT.mean())
    assert white(SNOW, None) == pytest.approx(1.0)
    assert white(SNOW, paint) == pytest.approx(1.0)
    for tinted in (SAND, BLEACHED):
        assert white(tinted, None) < 0.3
        assert white(tinted, paint) < 0.1
    # neutral, but far darker than the paint that is seen
    assert white(ASPHALT + 0.3 * (PAINT - ASPHALT), paint) == 0.0


def test_paint_that_is_not_there_hides_nowhere() -> None:
    levels = np.array([ASPHALT, SNOW])
    assert whiteness(levels, float(ASPHALT.mean()) + 0.03) == 0.0
    # worn, or diluted with the pavement next to it, it may look like the ground
    assert whiteness(levels, 0.5 * float((ASPHALT + SNOW).mean())) == pytest.approx(1.0)


def painted(line_px: int) -> np.ndarray:
    """Return a runway, grey 110, with a dashed centre line of 230 in ground of 200."""
    image = np.full((200, 320, 3), 200, np.uint8)
    for row in range(100, 181):
        half = 40 + (row - 100) * 60 // 80
        image[row, 160 - half : 160 + half] = 110
        if row % 20 < 12:
            image[row, 160 : 160 + line_px] = 230
    return image


def test_the_paint_of_a_picture_is_that_of_the_pavement_where_it_is_resolved() -> None:
    """Expected: the centre line's level, not the ground's; the pavement's without a line; none at 2 px in a metre."""
    for line_px, level in ((2, 230), (0, 110)):
        sight = PaintSight(image=painted(line_px), rows_px=ROWS, width_m=20.0)
        assert sight.level(CROSSINGS) == pytest.approx(level / 255.0)
    assert PaintSight(image=painted(2), rows_px=ROWS, width_m=100.0).level(CROSSINGS) is None
    beyond = PaintSight(image=painted(2)[:90], rows_px=ROWS, width_m=20.0)
    assert beyond.level(CROSSINGS) is None
