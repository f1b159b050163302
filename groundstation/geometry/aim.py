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
    pan, tilt = math.atan2(-x, y), math.atan2(z, math.hypot(x, y))
    u0, v0 = geometry.lens.principal_point_px
    for _ in range(_STEPS):
        projection = geometry.project(point_runway_m, pan, tilt)
        if projection is None:
            return None
        # plain numbers: for two unknowns numpy's calls take longer than all else
        u, v = projection.pixel.tolist()
        (u_pan, u_tilt), (v_pan, v_tilt) = projection.jacobian[:, 3:].tolist()
        turn = u_pan * v_tilt - u_tilt * v_pan
        if abs(turn) < _LEAST_TURN * (u_pan**2 + u_tilt**2 + v_pan**2 + v_tilt**2):
            return None
        u_off, v_off = u - u0, v - v0
        if max(abs(u_off), abs(v_off)) < _NEAR_PX:
            return Aim(pan_rad=float(pan), tilt_rad=float(tilt))
        pan -= (v_tilt * u_off - u_tilt * v_off) / turn
        tilt -= (u_pan * v_off - v_pan * u_off) / turn
    return None
