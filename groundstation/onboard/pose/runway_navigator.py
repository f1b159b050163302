"""Runway corners and inertial samples in, a trajectory relative to the runway out."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.pose.inertial_filter import (
    ATTITUDE,
    POSITION,
    CameraMount,
    ImuSample,
    InertialConfig,
    InertialFilter,
    Navigation,
    PoseInnovation,
    PoseObservation,
)
from groundstation.onboard.pose.pose_solver import (
    PointCorrespondences,
    PoseStatus,
    RunwayPose,
    pose_covariance,
    solve_pose,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PictureResult:
    """What one picture gave: the solver's pose, and the filter's innovation where the pose reached the filter."""

    pose: RunwayPose | None
    innovation: PoseInnovation | None


class RunwayNavigator:
    """An inertial filter fed with the poses of a runway's corners."""

    def __init__(self, config: InertialConfig, mount: CameraMount) -> None:
        self.filter = InertialFilter(config, mount)

    @property
    def navigation(self) -> Navigation:
        """Return the filter's state."""
        return self.filter.navigation

    def process_imu(self, sample: ImuSample) -> None:
        """Take an inertial sample."""
        self.filter.process_imu(sample)

    def update(self, t_s: float, seen: PointCorrespondences) -> PictureResult:
        """Take a picture's corners; a pose that does not fit them never reaches the filter."""
        pose = solve_pose(seen)
        if pose is None or pose.status is not PoseStatus.OK:
            return PictureResult(pose=pose, innovation=None)
        observation = PoseObservation(
            t_s=t_s,
            position_m=pose.position_m,
            runway_from_camera_wxyz=pose.runway_from_camera_wxyz,
            covariance=self._covariance(seen, pose),
        )
        return PictureResult(pose=pose, innovation=self.filter.update(observation))

    def _covariance(self, seen: PointCorrespondences, pose: RunwayPose) -> FloatArray:
        """Return the pose's covariance, taken at the state's pose where that has the smaller covariance.

        A pose that is too near has too small a covariance: with its own weights, the mean would be biased that way.
        """
        if not self.filter.started:
            return pose.covariance
        P = self.filter.navigation.P
        ours = np.trace(P[POSITION, POSITION]) + pose.range_m**2 * np.trace(P[ATTITUDE, ATTITUDE])
        theirs = np.trace(pose.covariance[:3, :3]) + pose.range_m**2 * np.trace(pose.covariance[3:, 3:])
        if ours > theirs:
            return pose.covariance
        position, wxyz = self.filter.camera_pose()
        return pose_covariance(seen, position, wxyz)
