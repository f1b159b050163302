"""Scenery of a runway, as one object of plain parameters; the defaults are the standard site."""

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import (
    require,
    require_finite,
    require_fraction,
    require_not_negative,
    require_positive,
)
from groundstation.simulation.scenery.light import Haze, SceneryLight, Sky, require_colour
from groundstation.simulation.scenery.noise_kernels import glow
from groundstation.simulation.scenery.runway_paint import RunwayPaint
from groundstation.simulation.scenery.scenery_objects import SceneryObject
from groundstation.simulation.scenery.surfaces import Colour, GroundPatch, Surface, require_tint


class Marking(StrEnum):
    """Markings of a runway."""

    FULL = "full"
    CENTRE = "centre"
    EDGES = "edges"
    ENDS = "ends"
    NONE = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunwayLook:
    """Appearance of a runway.

    Attributes
    ----------
    surface, tint_bgr : its material, and factors on that material's colours.
    texture : how strongly that surface's colours vary, as a factor.
    marking, marking_bgr : its markings; ``paint`` their sizes.
    wear : share of the paint that is worn off.
    tyre_marks : how dark the rubber at the aim mark is, from 0 to 1.
    """

    surface: Surface = Surface.ASPHALT
    tint_bgr: Colour = (1.0, 1.0, 1.0)
    texture: float = 1.0
    marking: Marking = Marking.FULL
    marking_bgr: Colour = (205.0, 206.0, 207.0)
    wear: float = 0.0
    tyre_marks: float = 0.0
    paint: RunwayPaint = field(default_factory=RunwayPaint)

    def __post_init__(self) -> None:
        require_tint("RunwayLook: tint_bgr", self.tint_bgr)
        require_not_negative("RunwayLook: texture", self.texture)
        require_colour("RunwayLook: marking_bgr", self.marking_bgr)
        require_fraction("RunwayLook: wear", self.wear)
        require_fraction("RunwayLook: tyre_marks", self.tyre_marks)


@dataclass(frozen=True, slots=True, kw_only=True)
class Skyline:
    """The distant skyline: a ring of trees, and hills.

    Attributes
    ----------
    trees_m, trees_height_m : radius of the ring around the origin, and how high its trees are.
    trees_gap : level of a noise of 0 to 1 above which there are trees; 1 is none.
    trees_bgr : their colour in full light.
    trees_solid : whether they are attenuated by haze and hide objects behind them.
    hills_rad, hills_relief_rad, hills_detail_rad : mean elevation of the skyline, and its wide and narrow variation.
    hills_bgr, hills_m : their colour, and how far off haze takes them to be; 0 where the colour is as seen.
    trees_texture, hills_texture : how strongly the colours of trees and hills vary, as factors.
    """

    trees_m: float = 520.0
    trees_height_m: float = 12.0
    trees_gap: float = 0.55
    trees_bgr: Colour = (58.0, 72.0, 58.0)
    trees_solid: bool = False
    hills_rad: float = 0.010
    hills_relief_rad: float = 0.014
    hills_detail_rad: float = 0.006
    hills_bgr: Colour = (150.0, 146.0, 128.0)
    hills_m: float = 0.0
    trees_texture: float = 1.0
    hills_texture: float = 1.0

    def __post_init__(self) -> None:
        require_positive("Skyline: trees_m", self.trees_m)
        require_positive("Skyline: trees_height_m", self.trees_height_m)
        require_fraction("Skyline: trees_gap", self.trees_gap)
        require_colour("Skyline: trees_bgr", self.trees_bgr)
        require_colour("Skyline: hills_bgr", self.hills_bgr)
        require_finite("Skyline: hills_rad", self.hills_rad)
        for name in ("hills_relief_rad", "hills_detail_rad", "hills_m", "trees_texture", "hills_texture"):
            require_not_negative(f"Skyline: {name}", getattr(self, name))


class SceneryName(StrEnum):
    """Kinds of surroundings that `draw_scenery` draws."""

    MEADOW = "meadow"
    DRY_FIELD = "dry-field"
    FARMLAND = "farmland"
    FOREST_EDGE = "forest-edge"
    VILLAGE = "village"
    INDUSTRIAL = "industrial"
    AIRPORT = "airport"
    DESERT = "desert"
    SNOW = "snow"
    COAST = "coast"
    LAKE = "lake"
    HILLS = "hills"


class SkyName(StrEnum):
    """Kinds of skies that `draw_scenery` draws."""

    CLEAR = "clear"
    FEW = "few"
    SCATTERED = "scattered"
    BROKEN = "broken"
    WHITE_OVERCAST = "white-overcast"
    DARK_OVERCAST = "dark-overcast"
    DUSK = "dusk"
    SUN_AHEAD = "sun-ahead"
    SUN_BEHIND = "sun-behind"
    HAZY = "hazy"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenery:
    """Scenery around the runway; lengths in m, runway frame.

    ``cloud_cover`` from 0 to 1; the sun's azimuth is from +y towards +x. ``mosaic`` from 0 to 1 is how much distant
    fields differ, ``ground_texture`` a factor on how strongly the ground's colours vary. ``drawn_scenery`` and
    ``drawn_sky`` are the kinds that it was drawn from, and have no effect.
    """

    seed: int = 0
    runway_half_width_m: float = 4.6
    runway_from_y_m: float = 12.0
    runway_to_y_m: float = 480.0
    aim_mark_y_m: float = 120.0
    cloud_cover: float = 0.35
    sun_azimuth_rad: float = math.radians(130.0)
    sun_elevation_rad: float = math.radians(38.0)
    drawn_scenery: SceneryName | None = None
    drawn_sky: SkyName | None = None
    ground: Surface = Surface.MEADOW
    ground_tint_bgr: Colour = (1.0, 1.0, 1.0)
    ground_texture: float = 1.0
    mosaic: float = 0.0
    runway: RunwayLook = field(default_factory=RunwayLook)
    skyline: Skyline = field(default_factory=Skyline)
    sky: Sky = field(default_factory=Sky)
    haze: Haze = field(default_factory=Haze)
    light: SceneryLight = field(default_factory=SceneryLight)
    patches: tuple[GroundPatch, ...] = ()
    objects: tuple[SceneryObject, ...] = ()

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
        require_fraction("Scenery: mosaic", self.mosaic)
        require_tint("Scenery: ground_tint_bgr", self.ground_tint_bgr)
        require_not_negative("Scenery: ground_texture", self.ground_texture)
        high = 0 < self.sun_elevation_rad <= 0.5 * math.pi
        require(high, "Scenery: sun_elevation_rad", got=self.sun_elevation_rad, wanted="above 0, at most π/2")

    @property
    def sun_runway(self) -> FloatArray:
        """Unit vector (3,) towards the sun, runway frame."""
        a, e = self.sun_azimuth_rad, self.sun_elevation_rad
        return np.array([math.cos(e) * math.sin(a), math.cos(e) * math.cos(a), math.sin(e)])

    def light_on(self, normals_runway: FloatArray) -> FloatArray:
        """Return the light (n, 3) BGR on surfaces of unit normals (n, 3), as factors on their colours."""
        lit = np.maximum(normals_runway @ self.sun_runway, 0.0)[:, None]
        light = self.light
        ambient = np.array(light.ambient_bgr) + np.array(light.from_sky_bgr) * normals_runway[:, 2:]
        return np.asarray(ambient + np.array(light.sun_bgr) * lit)

    def air_light(self, direction_runway: FloatArray) -> FloatArray:
        """Return what haze shows (3,) BGR, looked at in a direction (3,); brighter towards the sun."""
        length = float(np.linalg.norm(direction_runway))
        cosine = float(direction_runway @ self.sun_runway) / length if length > 0.0 else 0.0
        return np.array(self.haze.air_light_bgr) + 0.5 * glow(cosine, self.sky.sun_glow)
