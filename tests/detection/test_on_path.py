"""Whether something is where a target's path leads."""

from types import SimpleNamespace

import numpy as np
import pytest

from groundstation.single_camera.target_view import _ON_PATH, _PATH_SIGMAS, on_path


@pytest.mark.parametrize("wider_px", [0.0, 7.0])
def test_it_may_be_off_by_some_sigmas_and_a_share_of_its_size(wider_px: float) -> None:
    motion = SimpleNamespace(place=lambda: np.array([100.0, 50.0]), sigma_px=2.0)
    target = SimpleNamespace(motion=motion, length_px=30.0)
    reach = _PATH_SIGMAS * 2.0 + _ON_PATH * 30.0 + wider_px
    for off, on in ((0.0, True), (0.99 * reach, True), (1.01 * reach, False)):
        seen = SimpleNamespace(centroid_px=np.array([100.0 + 0.6 * off, 50.0 - 0.8 * off]))
        assert on_path(target, seen, wider_px) == on
