"""Where a PTU is to look for a target that is not seen: its predicted position's covariance as pan and tilt.

With the angles α that put the position p into the image's principal point, pixel(p, α) = c: by the implicit function
theorem ∂α/∂p = −J_α⁻¹ J_p, and the covariance of α is that of p through it. A fixed station has nothing to point.
"""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.aim import aim_at
from groundstation.geometry.station import StationGeometry


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointingRegion:
    """Angles at which a station would have the target in its image's middle, and how uncertain they are.

    ``pan_rad``, ``tilt_rad`` : the best guess; ``covariance_rad2`` (2, 2) of pan and tilt. ``half_pan_rad``,
    ``half_tilt_rad`` : half the box that holds the stated number of sigmas. ``in_one_view`` : whether the camera sees
    all of that box without turning.
    """

    station: str
    pan_rad: float
    tilt_rad: float
    covariance_rad2: FloatArray
    half_pan_rad: float
    half_tilt_rad: float
    in_one_view: bool


def pointing_region(
    geometry: StationGeometry, position_runway_m: FloatArray, covariance_m2: FloatArray, sigmas: float = 3.0
) -> PointingRegion | None:
    """Return the region of one station for a position (3,) with covariance (3, 3); None if it cannot be aimed at."""
    aim = aim_at(geometry, position_runway_m)
    if aim is None:
        return None
    projection = geometry.project(position_runway_m, aim.pan_rad, aim.tilt_rad)
    if projection is None:
        return None
    by_point, by_angle = projection.jacobian[:, :3], projection.jacobian[:, 3:]
    slope = -np.linalg.solve(by_angle, by_point)
    covariance = slope @ covariance_m2 @ slope.T
    pixels = by_point @ covariance_m2 @ by_point.T
    half = sigmas * np.sqrt(np.diag(covariance))
    size, middle = np.array(geometry.image_size_px), geometry.lens.principal_point_px
    room = np.minimum(middle + 0.5, size - 0.5 - middle)
    return PointingRegion(
        station=geometry.name,
        pan_rad=aim.pan_rad,
        tilt_rad=aim.tilt_rad,
        covariance_rad2=0.5 * (covariance + covariance.T),
        half_pan_rad=float(half[0]),
        half_tilt_rad=float(half[1]),
        in_one_view=bool(np.all(sigmas * np.sqrt(np.diag(pixels)) <= room)),
    )
