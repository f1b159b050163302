"""Light on a scenery: sky, haze and sunlight, as plain parameters."""

import math
from dataclasses import dataclass

from groundstation.simulation.parameter_checks import (
    require,
    require_finite,
    require_fraction,
    require_not_negative,
    require_positive,
)
from groundstation.simulation.scenery.surfaces import Colour, require_tint

_AMBIENT, _FROM_SKY = 0.34, 0.16
_DIRECT = 1.0 - _AMBIENT - _FROM_SKY
# Koschmieder: where a black object's contrast has fallen to 2 %, -ln 0.02 extinction lengths away
VISIBILITY_PER_EXTINCTION = 3.912


def require_colour(where: str, colour: Colour) -> None:
    """Raise `ScenarioError` unless B, G and R are from 0 to 255."""
    inside = all(0.0 <= part <= 255.0 for part in colour)
    require(inside, where, got=colour, wanted="three numbers from 0 to 255")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sky:
    """Colours of sky and clouds, BGR.

    Attributes
    ----------
    horizon_bgr, zenith_bgr : of the clear sky.
    gradient_rad : elevation at which 63 % of the way between them is made.
    cloud_bgr, cloud_base_bgr : where clouds are lit, and their dark parts.
    cloud_opacity : at the thickest, from 0 to 1.
    cloud_relief : how much of the dark part shows, from 0 to 1.
    cloud_size : of the largest, in heights of the layer of clouds.
    cloud_softness : of their edges; 0.45 is a veil, 0.1 a heap.
    clouds_from_rad : elevation below which there are none.
    sun_glow : how far the sky around the sun is brightened, in levels.
    sun_disc : whether the disc of the sun is drawn.
    """

    horizon_bgr: Colour = (222.0, 213.0, 203.0)
    zenith_bgr: Colour = (203.0, 158.0, 118.0)
    gradient_rad: float = 0.30
    cloud_bgr: Colour = (226.0, 224.0, 222.0)
    cloud_base_bgr: Colour = (170.0, 164.0, 158.0)
    cloud_opacity: float = 0.75
    cloud_relief: float = 0.0
    cloud_size: float = 3.0
    cloud_softness: float = 0.45
    clouds_from_rad: float = 0.03
    sun_glow: float = 0.0
    sun_disc: bool = False

    def __post_init__(self) -> None:
        for name in ("horizon_bgr", "zenith_bgr", "cloud_bgr", "cloud_base_bgr"):
            require_colour(f"Sky: {name}", getattr(self, name))
        for name in ("gradient_rad", "cloud_size", "cloud_softness"):
            require_positive(f"Sky: {name}", getattr(self, name))
        require_fraction("Sky: cloud_opacity", self.cloud_opacity)
        require_fraction("Sky: cloud_relief", self.cloud_relief)
        require_finite("Sky: clouds_from_rad", self.clouds_from_rad)
        require_not_negative("Sky: sun_glow", self.sun_glow)


@dataclass(frozen=True, slots=True, kw_only=True)
class Haze:
    """Attenuation by the air: contrast falls by e every ``extinction_m``.

    Attributes
    ----------
    extinction_m : distance within which contrast falls to 1/e.
    air_light_bgr : scattered light that replaces it.
    top_m : thickness of the hazy layer, through which the sky is visible; 0 leaves the sky unchanged.
    """

    extinction_m: float = 3500.0
    air_light_bgr: Colour = (176.0, 172.0, 158.0)
    top_m: float = 0.0

    def __post_init__(self) -> None:
        require_positive("Haze: extinction_m", self.extinction_m)
        require_colour("Haze: air_light_bgr", self.air_light_bgr)
        require_not_negative("Haze: top_m", self.top_m)

    @property
    def visibility_m(self) -> float:
        """Distance, m, at which a black object has 2 % of its contrast left."""
        return VISIBILITY_PER_EXTINCTION * self.extinction_m

    def clearness(self, distance_m: float) -> float:
        """Return the share of contrast that is left at a distance, m."""
        return math.exp(-distance_m / self.extinction_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneryLight:
    """Light on a surface of unit normal n: ambient + from_sky · n_z + sun · max(n · s, 0), factors on its colours.

    Attributes
    ----------
    ambient_bgr, from_sky_bgr, sun_bgr : the three parts.
    ground_bgr : light on the ground, in units of that in which `SURFACES` have their colours.
    shadow : share of that light which a shadow takes away.
    cloud_shadow : share of it that clouds take away in places.
    """

    ambient_bgr: Colour = (_AMBIENT, _AMBIENT, _AMBIENT)
    from_sky_bgr: Colour = (_FROM_SKY, _FROM_SKY, _FROM_SKY)
    sun_bgr: Colour = (_DIRECT, _DIRECT, _DIRECT)
    ground_bgr: Colour = (1.0, 1.0, 1.0)
    shadow: float = 0.5
    cloud_shadow: float = 0.0

    def __post_init__(self) -> None:
        for name in ("ambient_bgr", "from_sky_bgr", "sun_bgr", "ground_bgr"):
            require_tint(f"SceneryLight: {name}", getattr(self, name))
        require_fraction("SceneryLight: shadow", self.shadow)
        require_fraction("SceneryLight: cloud_shadow", self.cloud_shadow)
