"""The scene that rendered cameras observe: an aircraft on a trajectory, what else moves, and the scenery."""

from dataclasses import dataclass, field

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.airframe import Airframe
from groundstation.simulation.airframes.trainer import trainer
from groundstation.simulation.attitude import AircraftPose, pose_at
from groundstation.simulation.scene_body import AircraftBody, Body, Skin
from groundstation.simulation.scenery import Scenery
from groundstation.simulation.trajectory import OrientedTrajectory, Trajectory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RenderedScene:
    """An aircraft that flies a trajectory over a scenery; times are true session time in s, the frame is runway.

    ``traffic`` is what else moves.
    """

    trajectory: Trajectory
    airframe: Airframe = field(default_factory=trainer)
    scenery: Scenery = field(default_factory=Scenery)
    traffic: tuple[Body, ...] = ()

    @property
    def shadow_strength(self) -> float:
        """Share of the light that a shadow takes away."""
        return self.scenery.light.shadow

    def target(self) -> Body:
        """Return the aircraft as a body."""
        return AircraftBody(airframe=self.airframe, position=self._nose, pose=self.aircraft_at)

    def aircraft_at(self, t_s: float) -> AircraftPose:
        """Return the aircraft's pose at a time, s: its own attitude where the trajectory has one."""
        if isinstance(self.trajectory, OrientedTrajectory):
            times = np.array([t_s])
            return AircraftPose(
                position_runway_m=self.trajectory.position(times)[0],
                velocity_runway_m_s=self.trajectory.velocity(times)[0],
                runway_from_body=self.trajectory.attitude(t_s),
            )
        return pose_at(self.trajectory, t_s, self.airframe.rest_height_m)

    def shadow(self, corners_runway_m: FloatArray) -> FloatArray:
        """Return where the sun throws corners (n, 3, 3) onto the runway, (n, 3, 3)."""
        sun = self.scenery.sun_runway
        return np.asarray(corners_runway_m - (np.maximum(corners_runway_m[..., 2:], 0.0) / sun[2]) * sun)

    def shades(self, skin: Skin, towards_runway_m: FloatArray) -> FloatArray:
        """Return the colours (n, 3) BGR of a skin in sun, sky light and haze; (3,) m leads from the eye to it."""
        light = self.scenery.light_on(skin.normals_runway)
        clear = self.transmission(float(np.linalg.norm(towards_runway_m)))
        return np.asarray(clear * light * skin.colours_bgr + (1.0 - clear) * self.scenery.air_light(towards_runway_m))

    def transmission(self, distance_m: float) -> float:
        """Return the transmittance of the air over a distance, m."""
        return self.scenery.haze.clearness(distance_m)

    def _nose(self, t_s: float) -> FloatArray:
        return self.trajectory.position(np.array([t_s]))[0]
