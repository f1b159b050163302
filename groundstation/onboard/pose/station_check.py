"""A ground station checked by the runway's own corners: its camera's pose from them against its rig's."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS, parameter_indices
from groundstation.geometry.chi_square import chi_square_limit
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.onboard.pose.inertial_filter import rotation_vector
from groundstation.onboard.pose.pose_solver import PointCorrespondences, PoseStatus, RunwayPose, solve_pose
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Station

FALSE_ALARM = 0.01
# steps of the numeric derivative: m, rad and px are all of this size or larger
_STEP = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationCheck:
    """A camera's pose from corners against its rig's.

    Attributes
    ----------
    pose : from the corners, None where they allow none.
    difference : (6,) corners less rig: position in m, rotation vector in rad, runway frame; zeros without a pose.
    covariance : (6, 6) of it, corners and rig together.
    statistic, threshold : χ² of the difference, and what chance exceeds too rarely.
    """

    station: str
    pose: RunwayPose | None
    difference: FloatArray
    covariance: FloatArray
    statistic: float
    threshold: float

    @property
    def agrees(self) -> bool:
        """Return whether the corners are where the rig predicts them."""
        return self.pose is not None and self.pose.status is PoseStatus.OK and self.statistic <= self.threshold


def check_station(
    station: Station,
    known: ParameterCovariance,
    pan_rad: float,
    tilt_rad: float,
    corners_m: FloatArray,
    pixels: FloatArray,
    sigma_px: FloatArray,
    angle_sigma_rad: float | None = None,
    corner_sigma_m: FloatArray | None = None,
) -> StationCheck:
    """Compare one observation by a station of four or more corners of the runway with its rig.

    Parameters
    ----------
    known : the covariance of the station's calibration, `Rig.station_covariance`.
    pan_rad, tilt_rad : the encoder's readings.
    corners_m : (n, 3) surveyed, runway frame of the session.
    pixels, sigma_px : (n, 2) and (n,) their pixels, and one sigma of each coordinate.
    angle_sigma_rad : of one angle; by default the rig's own for one reading.
    corner_sigma_m : (n, 3) of the survey; exact by default.

    The rig's covariance of the lens is left out: its effect is less than a corner's noise.
    Raises `ValueError` where fewer than four corners, or pixels without a ray, are given.
    """
    covariance = np.asarray(sigma_px)[:, None, None] ** 2 * np.eye(2)
    if corner_sigma_m is not None:
        covariance = covariance + _survey_in_pixels(station, pan_rad, tilt_rad, corners_m, corner_sigma_m)
    seen = PointCorrespondences(points_m=corners_m, pixels=pixels, covariance_px2=covariance, lens=station.lens)
    pose = solve_pose(seen)
    threshold = float(chi_square_limit(FALSE_ALARM, 6))
    if pose is None:
        zero = np.zeros((6, 6))
        return StationCheck(
            station=station.name, pose=None, difference=np.zeros(6), covariance=zero, statistic=np.inf,
            threshold=threshold,
        )  # fmt: skip
    sigma = station.angle_sigma_rad if angle_sigma_rad is None else angle_sigma_rad
    by_rig = _pose_covariance(station, known, pan_rad, tilt_rad, sigma)
    difference = -_difference(station, pan_rad, tilt_rad, pose.position_m, _matrix(pose))
    total = pose.covariance + by_rig
    return StationCheck(
        station=station.name,
        pose=pose,
        difference=difference,
        covariance=total,
        statistic=float(difference @ np.linalg.solve(total, difference)),
        threshold=threshold,
    )


def _survey_in_pixels(
    station: Station, pan_rad: float, tilt_rad: float, corners_m: FloatArray, sigma_m: FloatArray
) -> FloatArray:
    """Return the corners' own uncertainty in the picture, (n, 2, 2); zero for one behind the camera."""
    geometry = station.geometry()
    out = np.zeros((len(corners_m), 2, 2))
    for k, (corner, sigma) in enumerate(zip(corners_m, sigma_m, strict=True)):
        projection = geometry.project(corner, pan_rad, tilt_rad)
        if projection is not None:
            J = projection.jacobian[:, :3] * sigma
            out[k] = J @ J.T
    return out


def _matrix(pose: RunwayPose) -> FloatArray:
    return matrix_from_wxyz(pose.runway_from_camera_wxyz)


def _difference(
    station: Station, pan_rad: float, tilt_rad: float, position_m: FloatArray, runway_from_camera: FloatArray
) -> FloatArray:
    """Return the rig's camera pose less another, (6,)."""
    reported = station.geometry().camera_pose(pan_rad, tilt_rad)
    turn = rotation_vector(reported.runway_from_camera @ runway_from_camera.T)
    return np.concatenate([reported.position_runway_m - position_m, turn])


def _pose_covariance(
    station: Station, known: ParameterCovariance, pan_rad: float, tilt_rad: float, angle_sigma_rad: float
) -> FloatArray:
    """Return the covariance of the camera's pose by the rig's own covariance and the encoders' noise, (6, 6)."""
    at = station.geometry().camera_pose(pan_rad, tilt_rad)

    def pose(one: Station, pan: float, tilt: float) -> FloatArray:
        return _difference(one, pan, tilt, at.position_runway_m, at.runway_from_camera)

    columns = [
        (pose(station, pan_rad + _STEP, tilt_rad) - pose(station, pan_rad - _STEP, tilt_rad)) / (2 * _STEP),
        (pose(station, pan_rad, tilt_rad + _STEP) - pose(station, pan_rad, tilt_rad - _STEP)) / (2 * _STEP),
    ]
    angles = np.array(columns).T
    covariance = angle_sigma_rad**2 * angles @ angles.T
    if known.names:
        slopes = []
        for place in parameter_indices(known.names):
            step = np.zeros(len(CALIBRATION_PARAMETERS))
            step[place] = _STEP
            more = pose(station.changed(step), pan_rad, tilt_rad)
            less = pose(station.changed(-step), pan_rad, tilt_rad)
            slopes.append((more - less) / (2 * _STEP))
        J = np.array(slopes).T
        covariance = covariance + J @ known.matrix @ J.T
    return np.asarray(covariance)
