"""Pose of the nose camera from position and attitude, in this project's convention and in the paper's.

The ``threshold`` frame: origin in the middle of the near threshold, y along the runway towards the approaching
aircraft, z up, x completing it (right-handed; on the left of the picture during an approach). Its runway lies in
z = 0 at y ≤ 0. Attitude is aeronautical: yaw clockwise seen from above, pitch nose up, roll right wing down.

Abu-Jbara, Sundaramoorthi & Claudel 2018, Section III.C and Appendixes B and C.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.camera import Lens
from groundstation.geometry.geodesy import enu_from_geodetic
from groundstation.geometry.rotation import rotation_from_vector, rotation_x, rotation_y, rotation_z
from groundstation.onboard.edges.line_kernel import ground_of

EARTH_RADIUS_M = 6_371_000.0
# forward, right and down of a level aircraft that lands straight ahead
_THRESHOLD_FROM_LEVEL = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_BODY_FROM_STRAIGHT_CAMERA = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class Attitude:
    """Roll, pitch and yaw in rad; yaw from the landing direction, clockwise seen from above."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0

    @property
    def matrix(self) -> FloatArray:
        """Return level_from_body (3, 3) in forward, right, down."""
        return rotation_z(self.yaw_rad) @ rotation_y(self.pitch_rad) @ rotation_x(self.roll_rad)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoseCameraPose:
    """A camera over the runway.

    Attributes
    ----------
    threshold_from_camera : rotation (3, 3); camera x right, y down, z forward.
    camera_threshold_m : the projection centre (3,), threshold frame, m; z > 0.
    """

    threshold_from_camera: FloatArray
    camera_threshold_m: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class RunwayPlace:
    """Where the near threshold's middle is and which way one lands: degrees, m, and rad clockwise from north."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    heading_rad: float


def nose_pose(position_threshold_m: FloatArray, attitude: Attitude, mount: Attitude | None = None) -> NoseCameraPose:
    """Return the pose of a camera on an aircraft.

    Parameters
    ----------
    position_threshold_m : the camera (3,), threshold frame.
    attitude : of the aircraft.
    mount : of the camera in the aircraft; None for a camera along the body axis.
    """
    body_from_camera = (mount or Attitude()).matrix @ _BODY_FROM_STRAIGHT_CAMERA
    return NoseCameraPose(
        threshold_from_camera=_THRESHOLD_FROM_LEVEL @ attitude.matrix @ body_from_camera,
        camera_threshold_m=np.asarray(position_threshold_m, dtype=np.float64),
    )


def level_from_body(threshold_from_camera: FloatArray, mount: Attitude) -> FloatArray:
    """Return an aircraft's attitude (3, 3), as `Attitude.matrix`, from that of a camera in it."""
    body_from_camera = mount.matrix @ _BODY_FROM_STRAIGHT_CAMERA
    return np.asarray(_THRESHOLD_FROM_LEVEL.T @ threshold_from_camera @ body_from_camera.T)


def corrected_pose(pose: NoseCameraPose, roll_rad: float, pitch_rad: float, up_m: float) -> NoseCameraPose:
    """Return a pose turned about the camera's own z axis (roll) and x axis (pitch), and raised."""
    turn = rotation_from_vector(np.array([pitch_rad, 0.0, roll_rad]))
    return NoseCameraPose(
        threshold_from_camera=pose.threshold_from_camera @ turn,
        camera_threshold_m=pose.camera_threshold_m + np.array([0.0, 0.0, up_m]),
    )


def threshold_position(lat_deg: float, lon_deg: float, alt_m: float, place: RunwayPlace) -> FloatArray:
    """Return a place on Earth (WGS 84) in the threshold frame, (3,) in m."""
    lat, lon, alt = (np.array([value]) for value in (lat_deg, lon_deg, alt_m))
    enu = enu_from_geodetic(lat, lon, alt, (place.lat_deg, place.lon_deg, place.alt_m))[0]
    s, c = math.sin(place.heading_rad), math.cos(place.heading_rad)
    return np.array([[-c, s, 0.0], [-s, -c, 0.0], [0.0, 0.0, 1.0]]) @ enu


def paper_rotation(roll_rad: float, pitch_rad: float, yaw_rad: float) -> FloatArray:
    """Return the paper's R = R_y(−θ) R_x(φ) R_z(Ψ), Eq. 35, as printed, (3, 3).

    Its Earth axes are those of Eq. 36: east, down, north. There R takes the camera's axes to the Earth's, with yaw θ
    counter-clockwise; in Eq. 26 its transpose belongs.
    """
    return rotation_y(-yaw_rad) @ rotation_x(pitch_rad) @ rotation_z(roll_rad)


def paper_translation(
    lat_deg: float, lon_deg: float, alt_m: float, origin: RunwayPlace, radius_m: float = EARTH_RADIUS_M
) -> FloatArray:
    """Return the paper's place of the aircraft on a round Earth: east, down, north (3,) in m, Eq. 36."""
    middle = math.radians(0.5 * (lat_deg + origin.lat_deg))
    east = radius_m * math.radians(lon_deg - origin.lon_deg) * math.cos(middle)
    return np.array([east, origin.alt_m - alt_m, radius_m * math.radians(lat_deg - origin.lat_deg)])


def paper_pose(rotation: FloatArray, translation_m: FloatArray, heading_rad: float) -> NoseCameraPose:
    """Return the paper's R (3, 3) and t (3,) as a pose over a runway that is landed on with ``heading_rad``."""
    s, c = math.sin(heading_rad), math.cos(heading_rad)
    threshold_from_earth = np.array([[-c, 0.0, s], [-s, 0.0, -c], [0.0, -1.0, 0.0]])
    return NoseCameraPose(
        threshold_from_camera=threshold_from_earth @ rotation,
        camera_threshold_m=threshold_from_earth @ translation_m,
    )


def intrinsic_matrix(lens: Lens) -> FloatArray:
    """Return κ (3, 3) of a lens, without its distortion, Eq. 28."""
    return np.array(
        [
            [lens.focal_px[0], 0.0, lens.principal_point_px[0]],
            [0.0, lens.focal_px[1], lens.principal_point_px[1]],
            [0.0, 0.0, 1.0],
        ]
    )


def ground_from_pixels(pose: NoseCameraPose, kappa: FloatArray, pixels: FloatArray) -> FloatArray:
    """Return where the rays of pixels (n, 2) meet the ground, (n, 2) in m, Eqs. C6 and C7; NaN above the horizon."""
    return np.asarray(ground_of(pixels, pose.threshold_from_camera, pose.camera_threshold_m, kappa))


def pixels_from_points(pose: NoseCameraPose, kappa: FloatArray, points_m: FloatArray) -> FloatArray:
    """Return the pixels (n, 2) of threshold-frame points (n, 3); NaN behind the camera."""
    camera = (points_m - pose.camera_threshold_m) @ pose.threshold_from_camera
    with np.errstate(divide="ignore", invalid="ignore"):
        homogeneous = camera @ kappa.T
        pixels = homogeneous[:, :2] / homogeneous[:, 2:]
    pixels[camera[:, 2] <= 0.1] = np.nan
    return np.asarray(pixels)
