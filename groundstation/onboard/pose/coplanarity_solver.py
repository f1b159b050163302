"""The pose from coplanarity constraints, as in the paper on runway pose by unit dual quaternion: the reference method.

Two constraints for each pair of corners: n·(R d) = 0, eq. (16), and n·(R p + t) = 0, eq. (17), n the normal of the
plane through the camera and both corners, d the direction from one to the other. All residuals count equally. Of the
two corners p of a pair the nearer one is used: the residual is in metres and grows with p's distance; with the farther
ones the range is several times worse.
"""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, IntArray
from groundstation.geometry.dual_quaternion import normalised
from groundstation.onboard.pose.camera_kernel import matrix_of, pose_of, turned_to_front
from groundstation.onboard.pose.levenberg_marquardt import COPLANARITY, PoseCost, levenberg_marquardt
from groundstation.onboard.pose.pose_solver import (
    TOLERANCE,
    PointCorrespondences,
    SolverInput,
    first_poses,
    pair_normals,
)

# of the corners in `runway.CORNERS` order, the farther one first
SIX_PAIRS = np.array([[1, 2], [1, 0], [1, 3], [2, 0], [2, 3], [0, 3]], dtype=np.int64)
FOUR_SIDES = np.array([[1, 2], [1, 0], [2, 3], [0, 3]], dtype=np.int64)
# soft unit constraints make a long valley
_MOST_STEPS = 500
_NO_ROWS = np.zeros((0, 4))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoplanarityPose:
    """The minimum of the paper's cost: camera position (3,) in m, camera_from_runway (8,) unit, in m, and the steps."""

    position_m: FloatArray
    camera_from_runway: FloatArray
    steps: int
    converged: bool


def solve_coplanarity(
    seen: PointCorrespondences, pairs: IntArray = SIX_PAIRS, start: tuple[FloatArray, FloatArray] | None = None
) -> CoplanarityPose | None:
    """Minimise the paper's cost over ``pairs`` (m, 2) of points, from ``start`` or what three points allow.

    Returns None without a start. ``start`` is runway_from_camera_wxyz (4,) and position_m (3,).
    """
    view = SolverInput(seen)
    if start is not None:
        q = view.dual(*start)
    else:
        starts = first_poses(view)
        if not len(starts):
            return None
        q = starts[0]
    normals = pair_normals(view.rays, pairs)
    problem = PoseCost(
        COPLANARITY, view.points, view.rays, view.tangents, _NO_ROWS, normals=normals, pairs=pairs, metres=view.scale_m
    )
    _, steps, converged = levenberg_marquardt(problem, q, _MOST_STEPS, TOLERANCE)
    turned_to_front(view.points, view.rays, q)
    unit = normalised(q)
    unit[4:] *= view.scale_m
    R, t = np.empty((3, 3)), np.empty(3)
    pose_of(unit, R, t)
    return CoplanarityPose(position_m=-R.T @ t, camera_from_runway=unit, steps=int(steps), converged=bool(converged))


def dual_part(real_wxyz: FloatArray, points: FloatArray, normals: FloatArray, pairs: IntArray) -> FloatArray:
    """Return q_d (4,) that best meets n·(R p + t) = 0 for a given camera_from_runway attitude, a linear problem.

    With t = 2 vec(q_d q_r*) the constraint is linear in q_d, and q_r · q_d = 0 is the fourth condition.
    """
    R = matrix_of(real_wxyz)
    turned = points @ R.T
    t, *_ = np.linalg.lstsq(normals, -np.einsum("mk,mk->m", normals, turned[pairs[:, 1]]), rcond=None)
    w, v = real_wxyz[0], real_wxyz[1:]
    return np.asarray(0.5 * np.concatenate([[-(t @ v)], w * t + np.cross(t, v)]))
