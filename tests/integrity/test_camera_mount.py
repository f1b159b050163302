"""Mounts that are seldom meant, and those of real cameras."""

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_x, rotation_z, wxyz_from_matrix
from groundstation.integrity.camera_mount import odd_mounts, odd_mounts_line

IDEAL = np.array([1.0, -1.0, 0.0, 0.0]) / np.sqrt(2.0)


@pytest.mark.parametrize(
    ("wxyz", "off_deg"),
    [
        (np.array([1.0, 0.0, 0.0, 0.0]), 90.0),
        (np.array([1.0, 1.0, 0.0, 0.0]) / np.sqrt(2.0), 180.0),
        # x, y, z, w
        (np.array([-1.0, 0.0, 0.0, 1.0]) / np.sqrt(2.0), 90.0),
    ],
)
def test_an_axis_that_is_turned_away_is_told(wxyz: FloatArray, off_deg: float) -> None:
    odd = odd_mounts({"left": wxyz, "right": IDEAL})
    assert odd == {"left": pytest.approx(off_deg, abs=0.01)}
    assert f"left's by {off_deg:.0f}°: an ideal camera has [0.7071, -0.7071, 0, 0]" in odd_mounts_line(odd)


@pytest.mark.parametrize("roll_deg", [0.0, 90.0, 180.0, -90.0])
def test_a_camera_that_is_upright_on_its_side_or_upside_down_is_not(roll_deg: float) -> None:
    rolled = rotation_x(np.radians(12.0)) @ matrix_from_wxyz(IDEAL) @ rotation_z(np.radians(roll_deg))
    assert odd_mounts({"left": wxyz_from_matrix(rolled)}) == {}
