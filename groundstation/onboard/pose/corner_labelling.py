"""The pose from four unlabelled corners: their assignment is part of the solution."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, IntArray
from groundstation.geometry.camera import Lens
from groundstation.onboard.pose.pose_solver import (
    KnownAttitude,
    PointCorrespondences,
    PoseStatus,
    RunwayPose,
    solve_pose,
)
from groundstation.onboard.pose.runway import Runway, orders_by_row

# a corner rounded to whole pixels
ROUNDING_SIGMA_PX = float(1.0 / np.sqrt(12.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LabelledPose:
    """A pose and the order in which the pixels are the runway's corners; ``pose`` is None without a solution."""

    pose: RunwayPose | None
    order: IntArray

    @property
    def status(self) -> PoseStatus:
        """Return how it ended."""
        return PoseStatus.NO_POSE if self.pose is None else self.pose.status


def solve_corners(
    runway: Runway, pixels: FloatArray, lens: Lens, sigma_px: float, known: KnownAttitude | None = None
) -> LabelledPose:
    """Find the pose from the runway's four corners (4, 2) in any order.

    The most likely order is used if it fits with the camera above the runway and before its middle, else the best of
    those that do, else the best fit of all.
    """
    covariance = np.broadcast_to(sigma_px**2 * np.eye(2), (4, 2, 2))
    found: list[LabelledPose] = []
    for order in orders_by_row(pixels):
        try:
            seen = PointCorrespondences(
                points_m=runway.corners_m, pixels=pixels[order], covariance_px2=covariance, lens=lens
            )
            pose = solve_pose(seen, known)
        except ValueError:
            pose = None
        labelled = LabelledPose(pose=pose, order=order)
        if pose is not None and pose.status is PoseStatus.OK and _plausible(pose, runway):
            return labelled
        found.append(labelled)
    with_pose = [one for one in found if one.pose is not None]
    if not with_pose:
        return found[0]
    return min(with_pose, key=lambda one: (not _plausible(one.pose, runway), one.pose.chi_square if one.pose else 0.0))


def _plausible(pose: RunwayPose | None, runway: Runway) -> bool:
    """Whether the camera is above the runway and closer to the near threshold than to the far one."""
    return pose is not None and pose.position_m[2] > 0 and pose.position_m[1] > -0.5 * runway.length_m
