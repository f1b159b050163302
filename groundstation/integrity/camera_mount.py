"""Mounts that turn a camera's optical axis away from the head's forward axis, which is seldom meant.

An ideal camera has the quaternion (0.7071, -0.7071, 0, 0), and a real one that turned by some degrees, or about its
optical axis. The identity, components in the order x, y, z, w and the inverse rotation turn the axis by 90° and more.
Rays may meet all the same, above or behind the stations, and other faults then explain them as well.
"""

import math
from collections.abc import Mapping

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz

# between the identity's 90° and mounts that are tilted on purpose
_MOST_OFF_DEG = 45.0


def odd_mounts(head_from_camera_wxyz: Mapping[str, FloatArray]) -> dict[str, float]:
    """Return by how much axes are off the head's forward axis, deg, where that is far; quaternions (4,) by station."""
    off_deg = {name: _off_deg(wxyz) for name, wxyz in head_from_camera_wxyz.items()}
    return {name: off for name, off in off_deg.items() if off > _MOST_OFF_DEG}


def odd_mounts_line(off_deg: Mapping[str, float]) -> str:
    """Return a line on mounts that turn the axis by ``off_deg``, by station."""
    words = " and ".join(f"{name}'s by {off:.0f}°" for name, off in off_deg.items())
    return (
        f"head_from_camera_wxyz turns the optical axis away from the head's forward axis, {words}: an ideal camera "
        "has [0.7071, -0.7071, 0, 0] (w, x, y, z), and a real one that turned by some degrees, unless it is mounted "
        "aside on purpose"
    )


def _off_deg(wxyz: FloatArray) -> float:
    right, forward, up = matrix_from_wxyz(wxyz)[:, 2]
    return math.degrees(math.atan2(math.hypot(right, up), forward))
