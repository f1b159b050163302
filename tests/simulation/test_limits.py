"""Bounds of what can be simulated: the largest picture, the steepest climb."""

import math
from types import SimpleNamespace

import pytest

from groundstation.errors import ScenarioError
from groundstation.simulation.rendered_camera import MAX_SIZE_PX, RenderedCamera
from groundstation.simulation.take_off import TakeOff


def test_a_climb_is_less_than_straight_up() -> None:
    assert TakeOff(climb_rad=math.radians(89.0)).climb_rad < math.pi / 2
    with pytest.raises(ScenarioError, match="climb_rad"):
        TakeOff(climb_rad=math.pi / 2)


@pytest.mark.parametrize(("size_px", "refused"), [(MAX_SIZE_PX, False), (MAX_SIZE_PX + 1, True)])
def test_the_largest_picture_is_allowed(size_px: int, refused: bool) -> None:
    class ReachedError(Exception):
        """The size was accepted."""

    class Station:
        name = "left"
        lens = SimpleNamespace(image_size_px=(640, size_px))

    class RenderedScene:
        def __getattr__(self, name: str) -> object:
            raise ReachedError(name)

    with pytest.raises(ScenarioError if refused else (ReachedError, AttributeError)):
        RenderedCamera(world=RenderedScene(), station=Station())
