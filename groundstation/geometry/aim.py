"""Which pan and tilt put a point on the optical axis."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.station import StationGeometry

_STEPS = 10
_NEAR_PX = 1e-6
# straight above the pan axis panning turns nothing
_LEAST_TURN = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Aim:
    """A pan and a tilt of a station, rad."""

    pan_rad: float
    tilt_rad: float


def aim_at(geometry: StationGeometry, point_runway_m: FloatArray) -> Aim | None:
    """Return the angles that put a runway point (3,) on the principal point, or None if no angles do.

    Newton's method on the projection, from the direction of the point seen from the PTU.
    """
    runway_from_base = geometry.packed[0:9].reshape(3, 3)
    x, y, z = runway_from_base.T @ (np.asarray(point_runway_m, dtype=np.float64) - geometry.packed[9:12])
    angles = np.array([math.atan2(-x, y), math.atan2(z, math.hypot(x, y))])
    for _ in range(_STEPS):
        projection = geometry.project(point_runway_m, float(angles[0]), float(angles[1]))
        if projection is None:
            return None
        error = projection.pixel - geometry.lens.principal_point_px
        by_angle = projection.jacobian[:, 3:]
        if abs(np.linalg.det(by_angle)) < _LEAST_TURN * float((by_angle**2).sum()):
            return None
        if np.abs(error).max() < _NEAR_PX:
            return Aim(pan_rad=float(angles[0]), tilt_rad=float(angles[1]))
        angles = angles - np.linalg.solve(by_angle, error)
    return None
