"""The runway as two parallel lines on the ground, and as two lines of the picture.

State x = (a, b, c, d): a·x + b·y + c = 0 and a·x + b·y + d = 0 on the ground, a² + b² = 1, a ≥ 0 (Eqs. 12, 13, 20).
In the picture the edges are given by their `crossings` with an upper and a lower row: u of line 1 (c) at both, u of
line 2 (d) at both. The paper's distances from the rectangle's corners are d₁ = u₁, d₂ = u₂, d₃ = L₁ − u₃,
d₄ = L₁ − u₄. During an approach line 1 is the left one.
"""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.line_kernel import (
    correlated_part,
    line_map_of,
    move_with_pose,
    project,
    state_through,
)
from groundstation.onboard.edges.line_state import A, B, C, D
from groundstation.onboard.edges.pose import NoseCameraPose, ground_from_pixels

STATE = ("a", "b", "c", "d")
_LINES = ((A, B, C), (A, B, D))


def line_map(pose: NoseCameraPose, kappa: FloatArray) -> FloatArray:
    """Return E = (κ[r₁ r₂ t])⁻ᵀ, (3, 3): a line of the ground to the line of the picture, Eqs. 30 and B15."""
    return line_map_of(pose.threshold_from_camera, pose.camera_threshold_m, kappa)


def measurement_matrix(pose: NoseCameraPose, kappa: FloatArray) -> FloatArray:
    """Return C_k (6, 4), Eqs. 34 and B19: both lines of the picture from the state (Eq. 32's second as in B17)."""
    e = line_map(pose, kappa)
    matrix = np.zeros((6, 4))
    matrix[:3, [A, B, C]] = e
    matrix[3:, [A, B, D]] = e
    return matrix


def normalised_lines(lines: FloatArray) -> FloatArray:
    """Return two lines of the picture (6,), each with a normal of length 1 that points to the right."""
    pair = np.reshape(lines, (2, 3))
    lengths = np.hypot(pair[:, 0], pair[:, 1]) * np.where(pair[:, 0] < 0.0, -1.0, 1.0)
    return np.asarray((pair / lengths[:, None]).ravel())


def lines_from_crossings(crossings_px: FloatArray, rows_px: FloatArray) -> FloatArray:
    """Return both lines of the picture (6,), normalised, from crossings (4,) with the rows (2,)."""
    (v0, v1), lines = rows_px, []
    for u0, u1 in np.reshape(crossings_px, (2, 2)):
        lines += [v1 - v0, u0 - u1, u1 * v0 - u0 * v1]
    return normalised_lines(np.array(lines))


def crossings_from_lines(lines: FloatArray, rows_px: FloatArray) -> FloatArray:
    """Return the crossings (4,) of two lines of the picture (6,) with the rows (2,)."""
    pair = np.reshape(lines, (2, 3))
    return np.asarray((-(pair[:, 1:2] * rows_px + pair[:, 2:3]) / pair[:, 0:1]).ravel())


def crossings_at(crossings_px: FloatArray, rows_px: FloatArray, wanted_px: FloatArray) -> FloatArray:
    """Return crossings (4,) with rows (2,) moved along their lines to other rows (2,)."""
    pair = np.reshape(crossings_px, (2, 2))
    slope = (pair[:, 1:] - pair[:, :1]) / (rows_px[1] - rows_px[0])
    return np.asarray((pair[:, :1] + slope * (wanted_px - rows_px[0])).ravel())


def project_lines(state: FloatArray, e: FloatArray, rows_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the crossings (4,) of a state (4,) with the rows (2,), and their derivative by the state (4, 4)."""
    crossings, jacobian = np.empty(4), np.empty((4, 4))
    project(state, e, rows_px, crossings, jacobian)
    return crossings, jacobian


def pose_jacobian(crossings_px: FloatArray, rows_px: FloatArray, pose: NoseCameraPose, kappa: FloatArray) -> FloatArray:
    """Return how crossings move with the pose, (4, 6): rotation vector (3,) and shift (3,), camera frame.

    The camera turns by θ (threshold_from_camera → threshold_from_camera · exp[θ]×) and moves by its own axes.
    """
    jacobian = np.empty((4, 6))
    move_with_pose(crossings_px, rows_px, pose.threshold_from_camera, pose.camera_threshold_m, kappa, jacobian)
    return jacobian


def bias_jacobian(jacobian: FloatArray, pose: NoseCameraPose) -> FloatArray:
    """Return how crossings move with (ROLL, PITCH, UP), (4, 3), from `pose_jacobian`'s (4, 6)."""
    out = np.empty((4, 3))
    correlated_part(jacobian, pose.threshold_from_camera, out)
    return out


def state_from_crossings(
    crossings_px: FloatArray, rows_px: FloatArray, pose: NoseCameraPose, kappa: FloatArray
) -> FloatArray:
    """Return the state (4,) of two lines of the picture; where they are not parallel, their mean direction.

    Each line then goes through the middle of its piece on the ground. NaN where a row is above the horizon.
    """
    pixels = np.empty((4, 2))
    pixels[:, 0], pixels[::2, 1], pixels[1::2, 1] = crossings_px, rows_px[0], rows_px[1]
    return state_from_ground(ground_from_pixels(pose, kappa, pixels).reshape(2, 2, 2))


def state_from_ground(ground: FloatArray) -> FloatArray:
    """Return the state (4,) of two lines through points of the ground (2, 2, 2): line, upper or lower row, x and y."""
    return np.asarray(state_through(ground))


def shifted(state: FloatArray, outwards_m: float) -> FloatArray:
    """Return the state with both lines moved away from each other; a negative number moves them together."""
    sign = 1.0 if state[C] >= state[D] else -1.0
    return state + sign * outwards_m * np.array([0.0, 0.0, 1.0, -1.0])


def angle_between(state: FloatArray) -> float:
    """Return the angle of the lines off the y axis, rad."""
    return float(np.arctan2(state[B], state[A]))
