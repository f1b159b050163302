"""A pan-tilt station: the pixel of a runway point, and the ray of a pixel.

Frames, signs and the lens model are those of docs/conventions.md.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import GroundstationError
from groundstation.geometry import kernels
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_x, rotation_y, rotation_z
from groundstation.geometry.station_layout import COS_LEAN, SIN_LEAN


class LensError(GroundstationError):
    """A pixel has no ray: the lens polynomial cannot be inverted there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Projection:
    """A projected point: ``pixel`` (2,) u, v; ``jacobian`` (2, 5) ∂(u, v)/∂(x, y, z, pan, tilt).

    Jacobian units: px per m and px per rad. ``depth_m`` is along the optical axis.
    """

    pixel: FloatArray
    jacobian: FloatArray
    depth_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ray:
    """Half-line in the runway frame: the camera's centre (3,) in m and a unit direction (3,)."""

    origin_runway_m: FloatArray
    direction_runway: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPose:
    """Pose of a camera: its centre (3,) in m, runway frame, and ``runway_from_camera`` (3, 3).

    The camera frame is OpenCV's: x right, y down, z along the optical axis.
    """

    position_runway_m: FloatArray
    runway_from_camera: FloatArray


class StationGeometry:
    """The measurement geometry of one calibrated station.

    Parameters
    ----------
    ptu_position_m : (3,) where the pan and tilt axes meet, runway frame.
    runway_from_base_wxyz, head_from_camera_wxyz : (4,) unit Hamilton quaternions.
    camera_in_head_m : (3,) the camera's centre in the head frame.
    lean_rad : angle by which the tilt axis leans out of the plane across the pan axis, about the head's forward axis.

    ``packed`` is the array that the compiled kernels take, for callers with a loop of their own.
    """

    __slots__ = ("image_size_px", "lens", "name", "packed")

    def __init__(
        self,
        *,
        name: str,
        ptu_position_m: FloatArray,
        runway_from_base_wxyz: FloatArray,
        head_from_camera_wxyz: FloatArray,
        camera_in_head_m: FloatArray,
        lens: Lens,
        lean_rad: float = 0.0,
    ) -> None:
        self.name = name
        self.lens = lens
        self.image_size_px = lens.image_size_px
        self.packed = np.concatenate(
            [
                matrix_from_wxyz(runway_from_base_wxyz).ravel(),
                ptu_position_m,
                matrix_from_wxyz(head_from_camera_wxyz).ravel(),
                camera_in_head_m,
                lens.focal_px,
                lens.principal_point_px,
                lens.distortion,
                [lens.radius_limit, np.cos(lean_rad), np.sin(lean_rad)],
            ]
        )

    def with_lens(self, lens: Lens) -> "StationGeometry":
        """Return the same station with another lens."""
        other = copy(self)
        other.lens, other.image_size_px = lens, lens.image_size_px
        numbers = [*lens.focal_px, *lens.principal_point_px, *lens.distortion, lens.radius_limit]
        other.packed = np.concatenate([self.packed[:24], numbers, self.packed[24 + len(numbers) :]])
        return other

    @property
    def lean_rad(self) -> float:
        """Return by how much the tilt axis leans, rad."""
        return float(np.arctan2(self.packed[SIN_LEAN], self.packed[COS_LEAN]))

    def project(self, point_runway_m: FloatArray, pan_rad: float, tilt_rad: float) -> Projection | None:
        """Return the pixel of a runway point (3,), or None if it is not in front of the camera.

        The pixel may be outside the image.
        """
        pixel, jacobian = np.empty(2), np.empty((2, 5))
        depth = kernels.project(self.packed, point_runway_m, pan_rad, tilt_rad, pixel, jacobian)
        if depth < kernels.MIN_DEPTH_M:
            return None
        return Projection(pixel=pixel, jacobian=jacobian, depth_m=depth)

    def ray(self, u_px: float, v_px: float, pan_rad: float, tilt_rad: float) -> Ray:
        """Return the ray of a pixel; raises `LensError` where the lens model has no inverse."""
        origin, direction = np.empty(3), np.empty(3)
        if not kernels.ray(self.packed, u_px, v_px, pan_rad, tilt_rad, origin, direction):
            raise LensError(f"station {self.name}: pixel ({u_px:.1f}, {v_px:.1f}) has no ray in its lens model")
        return Ray(origin_runway_m=origin, direction_runway=direction)

    def camera_pose(self, pan_rad: float, tilt_rad: float) -> CameraPose:
        """Return the camera's pose at one pair of angles, by the frames of docs/conventions.md."""
        runway_from_base = self.packed[0:9].reshape(3, 3)
        head_from_camera = self.packed[12:21].reshape(3, 3)
        runway_from_head = runway_from_base @ self.base_from_head(pan_rad, tilt_rad)
        return CameraPose(
            position_runway_m=self.packed[9:12] + runway_from_head @ self.packed[21:24],
            runway_from_camera=runway_from_head @ head_from_camera,
        )

    def base_from_head(self, pan_rad: float, tilt_rad: float) -> FloatArray:
        """Return the head's rotation (3, 3) at one pair of angles."""
        return rotation_z(pan_rad) @ rotation_y(self.lean_rad) @ rotation_x(tilt_rad)

    def contains(self, pixel: FloatArray, margin_px: float = 0.0) -> bool:
        """Return whether a pixel (2,) is in the image, at least ``margin_px`` from its border."""
        w, h = self.image_size_px
        inside_u = -0.5 + margin_px <= pixel[0] <= w - 0.5 - margin_px
        return bool(inside_u and -0.5 + margin_px <= pixel[1] <= h - 0.5 - margin_px)
