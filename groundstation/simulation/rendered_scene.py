"""The scene that rendered cameras observe: an aircraft on a trajectory and the scenery, from one seed."""

from dataclasses import dataclass, field

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframe import REST_HEIGHT_PER_SPAN, Airframe, trainer
from groundstation.simulation.attitude import AircraftPose, pose_at
from groundstation.simulation.scenery import Scenery
from groundstation.simulation.trajectory import Trajectory

_AMBIENT, _FROM_SKY = 0.34, 0.16
_HAZE_M = 3500.0
_HAZE_BGR = np.array([176.0, 172.0, 158.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RenderedScene:
    """An aircraft that flies a trajectory over a scenery; times are true session time in s, the frame is runway."""

    trajectory: Trajectory
    airframe: Airframe = field(default_factory=trainer)
    scenery: Scenery = field(default_factory=Scenery)

    def aircraft_at(self, t_s: float) -> AircraftPose:
        """Return the aircraft's pose at a time, s."""
        return pose_at(self.trajectory, t_s, REST_HEIGHT_PER_SPAN * self.airframe.span_m)

    def skin(self, pose: AircraftPose) -> FloatArray:
        """Return the corners (n, 3, 3) of the aircraft's triangles, m, runway frame."""
        return self.airframe.corners_body_m @ pose.runway_from_body.T + pose.position_runway_m

    def shadow(self, skin: FloatArray) -> FloatArray:
        """Return where the sun throws corners (n, 3, 3) onto the runway, (n, 3, 3)."""
        sun = self.scenery.sun_runway
        return np.asarray(skin - (np.maximum(skin[..., 2:], 0.0) / sun[2]) * sun)

    def shades(self, pose: AircraftPose, eye_runway_m: FloatArray) -> FloatArray:
        """Return the triangles' colours (n, 3) BGR in sun, sky light and haze."""
        normals = self.airframe.normals_body @ pose.runway_from_body.T
        lit = np.maximum(normals @ self.scenery.sun_runway, 0.0)
        light = _AMBIENT + _FROM_SKY * normals[:, 2] + (1.0 - _AMBIENT - _FROM_SKY) * lit
        distance = float(np.linalg.norm(pose.position_runway_m - eye_runway_m))
        clear = np.exp(-distance / _HAZE_M)
        return np.asarray(clear * light[:, None] * self.airframe.colours_bgr + (1.0 - clear) * _HAZE_BGR)
