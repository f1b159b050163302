"""Priors of a rotation that is started elsewhere than the rig has it, and readings thinned out."""

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.clocks.ptu_clock_fit import _thin
from calibration.mount.calibrate import _about

NAMES = ("runway_from_base.x", "head_from_camera.y", "camera_in_head.z")
STILL, TURNED = np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.8, 0.6, 0.0, 0.0])


@pytest.mark.parametrize(
    ("base", "camera", "expected"),
    [
        (STILL, STILL, [0.1, 0.2, 0.3]),
        (TURNED, STILL, [np.inf, 0.2, 0.3]),
        (STILL, TURNED, [0.1, np.inf, 0.3]),
    ],
)
def test_a_rotation_that_was_found_is_free(base: np.ndarray, camera: np.ndarray, expected: list[float]) -> None:
    rig = SimpleNamespace(runway_from_base_wxyz=STILL, head_from_camera_wxyz=STILL)
    start = SimpleNamespace(runway_from_base_wxyz=base, head_from_camera_wxyz=camera)
    assert _about(np.array([0.1, 0.2, 0.3]), rig, start, NAMES).tolist() == expected


@pytest.mark.parametrize(("rate_hz", "step"), [(100.0, 20), (30.0, 6), (5.0, 1), (1.0, 1)])
def test_readings_are_thinned_to_five_a_second(rate_hz: float, step: int) -> None:
    readings = np.column_stack([np.arange(60) / rate_hz, np.zeros((60, 2))])
    np.testing.assert_array_equal(_thin(readings), readings[::step])
