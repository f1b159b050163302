"""A pose for each picture: that of a log, and where it has none that of the motion between pictures."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.camera_file import NoseCamera
from groundstation.onboard.edges.config import TrackerConfig, without_log
from groundstation.onboard.edges.imu_file import PoseLog
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.edges.pose_drift import NO_DRIFT, PoseDrift
from groundstation.onboard.edges.visual_odometry import (
    NoMotion,
    OdometryStep,
    VisualOdometry,
    composed,
    motion_between,
    share_of,
    turn_of,
)

# what a motion between pictures is wrong by
_BY_MOTION = without_log(TrackerConfig())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PicturePose:
    """A picture's pose, what it is wrong by besides the tuning, and whether a log has it."""

    pose: NoseCameraPose
    drift: PoseDrift = NO_DRIFT
    logged: bool


class PicturePoses:
    """Poses of pictures without distortion, in order of time.

    Parameters
    ----------
    kappa : intrinsic matrix (3, 3). camera : its start is the first picture's pose where there is no log.
    """

    def __init__(self, kappa: FloatArray, camera: NoseCamera, log: PoseLog | None) -> None:
        self._log, self._odometry = log, None
        if log is None and camera.start is not None:
            self._odometry = VisualOdometry(kappa, camera.start)
        self._bridge = None if log is None or not log.has_gaps else _GapBridge(kappa, log)
        self._logged = self._bridged = 0
        self._motionless: Counter[NoMotion] = Counter()

    def of(self, t_s: float, image: ImageArray) -> PicturePose | None:
        """Return the pose of a picture (h, w, 3), None where nothing gives one."""
        if self._log is not None:
            return self._by_log(self._log, t_s, image)
        if self._odometry is None:
            return None
        step = self._odometry.step(t_s, image)
        self._count(step)
        drift = PoseDrift(new_turn_rad=step.turn_rad, new_shift_m=step.shift_m)
        return PicturePose(pose=step.pose, drift=drift, logged=False)

    def _by_log(self, log: PoseLog, t_s: float, image: ImageArray) -> PicturePose | None:
        """Return the log's own pose where it has one, else from its last row on by the motion between pictures."""
        pose = log.pose(t_s)
        if pose is not None:
            self._logged += 1
            if self._bridge is not None:
                self._bridge.restart(t_s, image, pose)
            return PicturePose(pose=pose, logged=True)
        if self._bridge is None or not log.covers(t_s):
            return None
        step = self._bridge.step(t_s, image)
        if step is None:
            return None
        self._bridged += 1
        self._count(step)
        drift = PoseDrift(turn_rad=step.turn_rad, shift_m=step.shift_m)
        return PicturePose(pose=step.pose, drift=drift, logged=False)

    def _count(self, step: OdometryStep) -> None:
        if step.failure is not None:
            self._motionless[step.failure] += 1

    def lines(self) -> tuple[str, ...]:
        """Return in lines for the user where poses came from, as far as that was not the plain case."""
        lines = []
        if self._bridged:
            lines.append(
                f"poses: {self._logged} of the table, {self._bridged} in its gaps by the motion between pictures"
            )
        if self._motionless:
            reasons = sorted(self._motionless.items(), key=lambda item: (-item[1], item[0].value))
            why = ", ".join(f"{count} {reason.value}" for reason, count in reasons)
            count = self._motionless.total()
            lines.append(f"without motion from the picture before, the last motion goes on: {count} ({why})")
        return tuple(lines)


class _GapBridge:
    """Poses in the gaps of a log: from its last row on by the motion between pictures.

    A row between two pictures is followed by its share of their motion. The first picture of all has a pose between two
    rows, if one of them is near.
    """

    def __init__(self, kappa: FloatArray, log: PoseLog) -> None:
        self._kappa, self._log = kappa, log
        self._odometry: VisualOdometry | None = None
        self._t_s = 0.0
        # of what has come since the last row, rad² and m²
        self._turned = self._shifted = 0.0

    def restart(self, t_s: float, image: ImageArray, pose: NoseCameraPose) -> None:
        """Take a picture whose pose is known."""
        if self._odometry is None:
            self._odometry = VisualOdometry(self._kappa, pose)
        self._odometry.restart(t_s, image, pose)
        self._t_s, self._turned, self._shifted = t_s, 0.0, 0.0

    def step(self, t_s: float, image: ImageArray) -> OdometryStep | None:
        """Return the pose of a picture in a gap with all that it is wrong by, None where it has none."""
        if self._odometry is None:
            return self._begin(t_s, image)
        row, before_s = self._log.before(t_s), self._t_s
        found, share, self._t_s = self._odometry.step(t_s, image), 1.0, t_s
        if row.t_s > before_s and found.motion is not None:
            share = (t_s - row.t_s) / (t_s - before_s)
            self._odometry.pose = composed(row.pose, share_of(found.motion, share))
            self._turned = self._shifted = 0.0
        self._turned += share * _BY_MOTION.turn_sigma_rad**2 + (share * found.turn_rad) ** 2
        self._shifted += share * _BY_MOTION.shift_sigma_m**2 + (share * found.shift_m) ** 2
        pose = self._odometry.pose
        if pose.camera_threshold_m[2] <= 0.0:
            self._odometry = None
            return None
        return self._stated(pose, found.failure)

    def _begin(self, t_s: float, image: ImageArray) -> OdometryStep | None:
        """Return the pose of a picture that none has led to: as wrong as it is far from the nearest row."""
        around = self._log.in_gap(t_s)
        if around is None:
            return None
        pose, nearest = around
        self.restart(t_s, image, pose)
        gone = motion_between(nearest, pose)
        self._turned, self._shifted = turn_of(gone) ** 2, float(gone.second_in_first_m @ gone.second_in_first_m)
        return self._stated(pose, None)

    def _stated(self, pose: NoseCameraPose, failure: NoMotion | None) -> OdometryStep:
        turn_rad, shift_m = float(np.sqrt(self._turned)), float(np.sqrt(self._shifted))
        return OdometryStep(pose=pose, motion=None, failure=failure, turn_rad=turn_rad, shift_m=shift_m)
