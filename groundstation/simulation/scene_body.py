"""Bodies in a rendered scene: what each shows at a time, as triangles and lights in the runway frame."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.airframe import Airframe
from groundstation.simulation.attitude import AircraftPose


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skin:
    """Triangles of a body at one time.

    Attributes
    ----------
    corners_runway_m : (n, 3, 3) of n triangles.
    normals_runway : (n, 3) unit vectors, outward.
    colours_bgr : (n, 3) 0 to 255, in the camera's image in full light.
    opacity : (n,) from 0 to 1; below 1 is visible from both sides and hides that share of its background.
    """

    corners_runway_m: FloatArray
    normals_runway: FloatArray
    colours_bgr: FloatArray
    opacity: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointLight:
    """A lamp from one camera at one time: ``position_runway_m`` (3,) and ``candela_bgr`` (3,) towards the eye."""

    position_runway_m: FloatArray
    candela_bgr: FloatArray


class Body(Protocol):
    """Something that is drawn over the surroundings; times are true session time in s."""

    @property
    def reach_m(self) -> float:
        """Largest distance of its corners from its place, m."""

    @property
    def casts_shadow(self) -> bool:
        """Whether its shadow on the ground is drawn."""

    def place(self, t_s: float) -> FloatArray:
        """Return the point (3,) m, runway frame, by whose distance and motion it is drawn."""

    def skin(self, t_s: float) -> Skin:
        """Return its triangles."""

    def lights(self, t_s: float, eye_runway_m: FloatArray) -> tuple[PointLight, ...]:
        """Return the lamps that are lit towards an eye (3,) m."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AircraftBody:
    """An aircraft where ``position`` and ``pose`` put it at a time, s; its place is its nose."""

    airframe: Airframe
    position: Callable[[float], FloatArray]
    pose: Callable[[float], AircraftPose]
    casts_shadow: bool = True

    @property
    def reach_m(self) -> float:
        """Largest distance of its corners from its nose, m."""
        return float(np.linalg.norm(self.airframe.corners_body_m, axis=-1).max())

    def place(self, t_s: float) -> FloatArray:
        """Return its nose (3,) m."""
        return self.position(t_s)

    def skin(self, t_s: float) -> Skin:
        """Return its triangles."""
        pose = self.pose(t_s)
        turned = pose.runway_from_body.T
        return Skin(
            corners_runway_m=self.airframe.corners_body_m @ turned + pose.position_runway_m,
            normals_runway=self.airframe.normals_body @ turned,
            colours_bgr=self.airframe.colours_bgr,
            opacity=self.airframe.opacity,
        )

    def lights(self, t_s: float, eye_runway_m: FloatArray) -> tuple[PointLight, ...]:
        """Return the lamps that are lit towards an eye (3,) m."""
        lamps = self.airframe.lights
        if not lamps:
            return ()
        pose = self.pose(t_s)
        eye_body = pose.runway_from_body.T @ (eye_runway_m - pose.position_runway_m)
        lit = [(lamp, lamp.intensity_towards(eye_body, t_s)) for lamp in lamps]
        return tuple(
            PointLight(
                position_runway_m=pose.position_runway_m + pose.runway_from_body @ np.array(lamp.position_body_m),
                candela_bgr=candela / 255.0 * np.array(lamp.colour_bgr),
            )
            for lamp, candela in lit
            if candela > 0.0
        )
