"""The surroundings of a runway as one station sees them: two panoramas that never change.

Approximations: the eye stays where it is with pan and tilt at zero, so the ground does not shift by the lever arm
when the head turns (1 cm at 20 m is half a milliradian); hills and clouds are infinitely far away; the ground is
level; nothing in the surroundings moves. Fine detail is where aircraft land: within `FINE_AZIMUTH_RAD` of the runway's
direction and between `FINE_LOW_RAD` and `FINE_HIGH_RAD`; elsewhere it is coarser.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import require, require_fraction, require_positive
from groundstation.simulation.render_kernels import TILE, Panorama, flat_blocks
from groundstation.simulation.scenery_kernels import bake

FINE_AZIMUTH_RAD = math.radians(25.0)
FINE_LOW_RAD, FINE_HIGH_RAD = math.radians(-12.0), math.radians(5.0)
# of the lens's own pixels to a radian; interpolation then blurs about as a lens does
_FINE_SHARE = 0.8
_MAX_FINE_PIXELS = 10_000_000
_COARSER, _MAX_COARSE_DENSITY = 8.0, 350.0
# of a pixel off the plane through its block's corners, rounding included; noise is some two levels
_FLAT_LEVELS = 1.5
_LAP_RAD = 0.7  # the coarse panorama goes on beyond a full turn, so that no tile is torn


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenery:
    """What there is around the runway; lengths in m, runway frame.

    ``cloud_cover`` from 0 to 1; the sun's azimuth is from +y towards +x.
    """

    seed: int = 0
    runway_half_width_m: float = 4.6
    runway_from_y_m: float = 12.0
    runway_to_y_m: float = 480.0
    aim_mark_y_m: float = 120.0
    cloud_cover: float = 0.35
    sun_azimuth_rad: float = math.radians(130.0)
    sun_elevation_rad: float = math.radians(38.0)

    def __post_init__(self) -> None:
        require(
            isinstance(self.seed, int) and self.seed >= 0, "Scenery: seed", got=self.seed, wanted="a whole number ≥ 0"
        )
        require_positive("Scenery: runway_half_width_m", self.runway_half_width_m)
        wanted = f"beyond runway_from_y_m = {self.runway_from_y_m:g}"
        require(
            self.runway_to_y_m > self.runway_from_y_m, "Scenery: runway_to_y_m", got=self.runway_to_y_m, wanted=wanted
        )
        require_fraction("Scenery: cloud_cover", self.cloud_cover)
        high = 0 < self.sun_elevation_rad <= 0.5 * math.pi
        require(high, "Scenery: sun_elevation_rad", got=self.sun_elevation_rad, wanted="above 0, at most π/2")

    @property
    def sun_runway(self) -> FloatArray:
        """Unit vector (3,) towards the sun, runway frame."""
        a, e = self.sun_azimuth_rad, self.sun_elevation_rad
        return np.array([math.cos(e) * math.sin(a), math.cos(e) * math.cos(a), math.sin(e)])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surroundings:
    """What one station sees: ``fine`` where aircraft land, ``coarse`` all around."""

    fine: Panorama
    coarse: Panorama


def surroundings_of(scenery: Scenery, eye_runway_m: FloatArray, focal_px: float, grey: bool) -> Surroundings:
    """Draw what an eye (3,) sees through a lens of this focal length, px; takes some seconds."""
    area = 2.0 * FINE_AZIMUTH_RAD * (FINE_HIGH_RAD - FINE_LOW_RAD)
    density = min(_FINE_SHARE * focal_px, math.sqrt(_MAX_FINE_PIXELS / area))
    fine = _panorama(scenery, eye_runway_m, grey, density, FINE_AZIMUTH_RAD, (FINE_LOW_RAD, FINE_HIGH_RAD))
    all_round = (-0.5 * math.pi, 0.5 * math.pi)
    coarse_density = min(density / _COARSER, _MAX_COARSE_DENSITY)
    coarse = _panorama(scenery, eye_runway_m, grey, coarse_density, math.pi + _LAP_RAD, all_round)
    return Surroundings(fine=fine, coarse=coarse)


def _panorama(
    scenery: Scenery, eye: FloatArray, grey: bool, density: float, azimuth: float, elevations: tuple[float, float]
) -> Panorama:
    width = math.ceil(2.0 * azimuth * density)
    height = math.ceil((elevations[1] - elevations[0]) * density)
    image = np.empty((height, width, 3), np.uint8)
    runway = [scenery.runway_half_width_m, scenery.runway_from_y_m, scenery.runway_to_y_m, scenery.aim_mark_y_m]
    first = np.array([-azimuth, elevations[1]])
    bake(first, density, eye, np.array(runway), scenery.cloud_cover, scenery.seed, grey, image)
    flat = np.zeros((-(-height // TILE), -(-width // TILE)), dtype=bool)
    flat_blocks(image, _FLAT_LEVELS, flat)
    return Panorama(image=image, place=np.array([*first, density]), flat=flat)
