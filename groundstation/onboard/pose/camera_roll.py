"""How much an aircraft is rolled in a pose: exchanged columns look like an approach on a wing tip."""

import math
from collections.abc import Sequence

import numpy as np

from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.onboard.edges.pose import Attitude, level_from_body
from groundstation.onboard.pose.pose_solver import RunwayPose

# chosen: twice the bank of a steep turn (30°), half of the next thing that a table can be wrong by (90°, 180°)
MOST_ROLL_RAD = math.radians(60.0)
# with the body's axis steeper than this a roll is not told from a heading
_LEAST_LEVEL = 0.5


def roll_of(pose: RunwayPose, mount: Attitude) -> float | None:
    """Return the aircraft's roll in rad, right wing down; None where its axis is too steep to have one."""
    level = level_from_body(matrix_from_wxyz(pose.runway_from_camera_wxyz), mount)
    if math.hypot(level[2, 1], level[2, 2]) < _LEAST_LEVEL:
        return None
    return math.atan2(level[2, 1], level[2, 2])


def is_rolled(roll_rad: float | None) -> bool:
    """Return whether a roll is more than an aircraft on an approach has."""
    return roll_rad is not None and abs(roll_rad) > MOST_ROLL_RAD


def roll_doubt(rolls_rad: Sequence[float | None]) -> str:
    """Return what is likely wrong where more than half of the pictures are rolled; "" where they are not."""
    rolled = [roll for roll in rolls_rad if roll is not None and is_rolled(roll)]
    if 2 * len(rolled) <= len(rolls_rad):
        return ""
    # exchanged columns may give either sign from picture to picture
    middle = math.degrees(float(np.median(np.abs(rolled))))
    cause = "are x and y exchanged" if middle < 135.0 else "is y counted upwards from the lowest row"
    return (
        f"doubtful: {len(rolled)} of {len(rolls_rad)} pictures have the aircraft rolled by {middle:.0f} deg,"
        f" which no approach is flown with: {cause},"
        " or is the camera mounted so (mount_deg = [roll, pitch, yaw] in the file of --camera)?"
    )
