"""By how much a camera has turned since an earlier frame, where both places are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from groundstation.detection.background_motion import SceneModel
from groundstation.geometry.rotation import rotation_x, rotation_z


def memory(*, view: bool = True, rotation: bool = True) -> SceneModel:
    made = SceneModel.__new__(SceneModel)
    made._view = object() if view else None
    made._rotation = rotation_z(0.3) @ rotation_x(0.1) if rotation else None
    return made


def test_the_turn_is_from_the_earlier_camera_to_the_newest() -> None:
    turn = memory()._turned(SimpleNamespace(camera_from_runway=rotation_x(0.1)))
    np.testing.assert_allclose(turn, rotation_z(0.3), atol=1e-15)


@pytest.mark.parametrize(("view", "rotation", "kept"), [(False, True, True), (True, False, True), (True, True, False)])
def test_where_one_is_not_known_neither_is_the_turn(view: bool, rotation: bool, kept: bool) -> None:
    earlier = SimpleNamespace(camera_from_runway=rotation_x(0.1) if kept else None)
    assert memory(view=view, rotation=rotation)._turned(earlier) is None
