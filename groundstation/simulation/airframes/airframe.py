"""Render model of an aircraft: triangles with colours and opacity, lights, and height at rest.

Body frame: x forward, y right, z down, in m; its origin is the target point, the centre of the nose.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import (
    require,
    require_fraction,
    require_not_negative,
    require_positive,
    require_shape,
)

# luminance of white paint in full sun: 100 000 lx, reflectance 0.8, Lambertian
SUNLIT_WHITE_CD_M2 = 25_000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class AircraftLight:
    """A navigation, strobe or landing light.

    Attributes
    ----------
    position_body_m : where it is, body frame.
    colour_bgr : 0 to 255, the strongest channel 255.
    intensity : candela within its beam; a white skin in full sun has `SUNLIT_WHITE_CD_M2`.
    period_s, lit_share, phase : it is lit for that share of each period, from ``phase`` periods before time 0 on.
    axis_body, half_angle_rad : the cone that it shines into; π is all around.
    """

    position_body_m: tuple[float, float, float]
    colour_bgr: tuple[float, float, float]
    intensity: float
    period_s: float = 1.0
    lit_share: float = 1.0
    phase: float = 0.0
    axis_body: tuple[float, float, float] = (1.0, 0.0, 0.0)
    half_angle_rad: float = math.pi

    def __post_init__(self) -> None:
        require_not_negative("AircraftLight: intensity", self.intensity)
        require_positive("AircraftLight: period_s", self.period_s)
        require_fraction("AircraftLight: lit_share", self.lit_share)
        length = math.hypot(*self.axis_body)
        require(abs(length - 1.0) < 1e-6, "AircraftLight: axis_body", got=self.axis_body, wanted="a unit vector")

    def is_lit(self, t_s: float) -> bool:
        """Return whether it is lit at a time, s."""
        return (t_s / self.period_s + self.phase) % 1.0 < self.lit_share

    def intensity_towards(self, eye_body_m: FloatArray, t_s: float) -> float:
        """Return the intensity in candela towards a point (3,), body frame, at a time in s; half of it at the rim."""
        if not self.is_lit(t_s):
            return 0.0
        towards = eye_body_m - np.array(self.position_body_m)
        away = math.acos(float(np.clip(towards @ np.array(self.axis_body) / np.linalg.norm(towards), -1.0, 1.0)))
        if self.half_angle_rad >= math.pi:
            return self.intensity
        return float(self.intensity * 0.5 ** ((away / self.half_angle_rad) ** 2))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Airframe:
    """An aircraft's skin, lights and stand.

    Attributes
    ----------
    corners_body_m : (n, 3, 3) of n triangles.
    normals_body : (n, 3), outward.
    colours_bgr : (n, 3), 0 to 255, in the camera's image in full light.
    opacity : (n,), 1 but for what the turning propeller smears.
    span_m : from wing tip to wing tip.
    rest_height_m : of the nose above the runway when level on its gear.
    lights : of the aircraft.
    """

    corners_body_m: FloatArray
    normals_body: FloatArray
    colours_bgr: FloatArray
    opacity: FloatArray
    span_m: float
    rest_height_m: float
    lights: tuple[AircraftLight, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.corners_body_m)
        require_shape("Airframe: corners_body_m", self.corners_body_m, (count, 3, 3))
        require_shape("Airframe: normals_body", self.normals_body, (count, 3))
        require_shape("Airframe: colours_bgr", self.colours_bgr, (count, 3))
        require_shape("Airframe: opacity", self.opacity, (count,))
        require_positive("Airframe: span_m", self.span_m)
        require_not_negative("Airframe: rest_height_m", self.rest_height_m)
