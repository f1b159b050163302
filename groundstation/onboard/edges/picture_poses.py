"""A pose for each picture: that of a log, or where there is none that of the motion between pictures."""

from collections import Counter
from dataclasses import dataclass

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.camera_file import NoseCamera
from groundstation.onboard.edges.imu_file import PoseLog
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.edges.pose_drift import NO_DRIFT, PoseDrift
from groundstation.onboard.edges.visual_odometry import NoMotion, VisualOdometry


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
        self._log = log
        self._odometry = None
        if log is None and camera.start is not None:
            self._odometry = VisualOdometry(kappa, camera.start)
        self._motionless: Counter[NoMotion] = Counter()

    def of(self, t_s: float, image: ImageArray) -> PicturePose | None:
        """Return the pose of a picture (h, w, 3), None where nothing gives one."""
        if self._log is not None:
            pose = self._log.pose(t_s)
            return None if pose is None else PicturePose(pose=pose, logged=True)
        if self._odometry is None:
            return None
        step = self._odometry.step(t_s, image)
        if step.failure is not None:
            self._motionless[step.failure] += 1
        drift = PoseDrift(new_turn_rad=step.turn_rad, new_shift_m=step.shift_m)
        return PicturePose(pose=step.pose, drift=drift, logged=False)

    def lines(self) -> tuple[str, ...]:
        """Return in lines for the user where poses came from, as far as that was not the plain case."""
        if not self._motionless:
            return ()
        why = ", ".join(f"{count} {reason.value}" for reason, count in sorted(self._motionless.items(), key=_often))
        return (
            f"no motion between {self._motionless.total()} pictures and the one before, the last motion goes on: {why}",
        )


def _often(counted: tuple[NoMotion, int]) -> tuple[int, str]:
    return -counted[1], counted[0].value
