"""A scenery as the compiled kernels take it: named arrays and numbers."""

import math
from typing import NamedTuple

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.scenery.scenery import Marking, Scenery
from groundstation.simulation.scenery.surfaces import SURFACES, Colour, Surface

GROUND, RUNWAY, FIRST_PATCH = 0, 1, 2  # rows of `Tables.surfaces`


class Bgr(NamedTuple):
    """A colour, or factors on one; numbers, since compiled code counts references to arrays at each use."""

    b: float
    g: float
    r: float


class Direction(NamedTuple):
    """A unit vector, runway frame."""

    x: float
    y: float
    z: float


# one row a surface, see `SurfaceTones`; records, since compiled code reads them without counting references
SURFACE_ROW = np.dtype(
    [(f"{part}_{channel}", np.float64) for part in ("base", "wide", "fine") for channel in "bgr"]
    + [(name, np.float64) for name in ("wide_m", "fine_m", "along", "stripe", "stripe_m", "gloss")]
)
# one row a rectangle on the ground: middle, sine and cosine of the heading, half sizes, raggedness; m
PATCH_ROW = np.dtype(
    [(name, np.float64) for name in ("x", "y", "sine", "cosine", "half_length", "half_width", "ragged")]
)


class Tables(NamedTuple):
    """Surfaces (n) of `SURFACE_ROW` (ground, runway, then one for each patch) and patches (n) of `PATCH_ROW`."""

    surfaces: np.ndarray
    patches: np.ndarray


class RunwayTones(NamedTuple):
    """The runway's place, m, and paint: 1 or 0 for each kind of marking."""

    half: float
    start: float
    end: float
    aim: float
    paint: Bgr
    edge_line: float
    centre_line: float
    aim_blocks: float
    end_bars: float
    wear: float
    tyre_marks: float
    edge_width: float
    dash: float
    dash_every: float
    dash_half_width: float
    dash_from: float
    aim_length: float


class SkyTones(NamedTuple):
    """Sky, clouds, haze and sun."""

    horizon: Bgr
    zenith: Bgr
    gradient: float
    cover: float
    cloud: Bgr
    cloud_base: Bgr
    opacity: float
    relief: float
    size: float
    softness: float
    clouds_from: float
    glow: float
    disc: bool
    sun: Direction
    extinction: float
    air: Bgr
    haze_top: float


class SkylineTones(NamedTuple):
    """Ring of trees and hills."""

    trees_m: float
    trees_height: float
    trees_gap: float
    trees: Bgr
    trees_fine: Bgr
    solid: bool
    hill: float
    hill_relief: float
    hill_detail: float
    hills: Bgr
    hills_fine: Bgr
    hills_m: float


class FieldTones(NamedTuple):
    """Variation over distant land: fields, shadows of clouds."""

    mosaic: float
    crop: Bgr
    stubble: Bgr
    ploughed: Bgr
    cloud_shadow: float


class Tones(NamedTuple):
    """Everything but the tables."""

    sky: SkyTones
    skyline: SkylineTones
    runway: RunwayTones
    fields: FieldTones
    seed: int


def tones_of(scenery: Scenery) -> Tones:
    """Return a scenery as kernels take it."""
    light = np.array(scenery.light.ground_bgr)
    return Tones(
        sky=_sky(scenery),
        skyline=_skyline(scenery, light),
        runway=_runway(scenery, light),
        fields=FieldTones(
            mosaic=scenery.mosaic,
            crop=_times(light, SURFACES[Surface.CROP].base),
            stubble=_times(light, SURFACES[Surface.STUBBLE].base),
            ploughed=_times(light, SURFACES[Surface.PLOUGHED].base),
            cloud_shadow=scenery.light.cloud_shadow,
        ),
        seed=scenery.seed,
    )


def _times(light: FloatArray, colour: Colour) -> Bgr:
    return Bgr(*(light * colour).tolist())


def _sky(scenery: Scenery) -> SkyTones:
    sky, haze = scenery.sky, scenery.haze
    return SkyTones(
        horizon=Bgr(*sky.horizon_bgr),
        zenith=Bgr(*sky.zenith_bgr),
        gradient=sky.gradient_rad,
        cover=scenery.cloud_cover,
        cloud=Bgr(*sky.cloud_bgr),
        cloud_base=Bgr(*sky.cloud_base_bgr),
        opacity=sky.cloud_opacity,
        relief=sky.cloud_relief,
        size=sky.cloud_size,
        softness=sky.cloud_softness,
        clouds_from=sky.clouds_from_rad,
        glow=sky.sun_glow,
        disc=sky.sun_disc,
        sun=Direction(*scenery.sun_runway.tolist()),
        extinction=haze.extinction_m,
        air=Bgr(*haze.air_light_bgr),
        haze_top=haze.top_m,
    )


def _skyline(scenery: Scenery, light: FloatArray) -> SkylineTones:
    skyline = scenery.skyline
    # as seen, the standard site's hills and trees are lit already
    hills_light = light if skyline.hills_m > 0.0 else np.ones(3)
    return SkylineTones(
        trees_m=skyline.trees_m,
        trees_height=skyline.trees_height_m,
        trees_gap=skyline.trees_gap,
        trees=_times(light, skyline.trees_bgr),
        trees_fine=_times(skyline.trees_texture * light, (44.0, 56.0, 48.0)),
        solid=skyline.trees_solid,
        hill=skyline.hills_rad,
        hill_relief=skyline.hills_relief_rad,
        hill_detail=skyline.hills_detail_rad,
        hills=_times(hills_light, skyline.hills_bgr),
        hills_fine=_times(skyline.hills_texture * hills_light, (14.0, 16.0, 16.0)),
        hills_m=skyline.hills_m,
    )


def tables_of(scenery: Scenery) -> Tables:
    """Return a scenery's surfaces and patches as kernels take them."""
    light = np.array(scenery.light.ground_bgr)
    kinds: list[tuple[Surface, Colour, float]] = [
        (scenery.ground, scenery.ground_tint_bgr, scenery.ground_texture),
        (scenery.runway.surface, scenery.runway.tint_bgr, scenery.runway.texture),
        *((patch.surface, patch.tint_bgr, 1.0) for patch in scenery.patches),
    ]
    surfaces, patches = np.zeros(len(kinds), SURFACE_ROW), np.zeros(len(scenery.patches), PATCH_ROW)
    for row, (surface, tint, texture) in zip(surfaces, kinds, strict=True):
        tones = SURFACES[surface]
        for part, strength in (("base", 1.0), ("wide", texture), ("fine", texture)):
            for channel, value in zip("bgr", strength * light * tint * getattr(tones, part), strict=True):
                row[f"{part}_{channel}"] = value
        for name in ("wide_m", "fine_m", "along", "stripe", "stripe_m", "gloss"):
            row[name] = getattr(tones, name)
    for k, p in enumerate(scenery.patches):
        heading = (math.sin(p.heading_rad), math.cos(p.heading_rad))
        patches[k] = (p.x_m, p.y_m, *heading, 0.5 * p.length_m, 0.5 * p.width_m, p.ragged_m)
    return Tables(surfaces=surfaces, patches=patches)


def _runway(scenery: Scenery, light: FloatArray) -> RunwayTones:
    look = scenery.runway
    marking = look.marking
    full = marking is Marking.FULL
    return RunwayTones(
        half=float(scenery.runway_half_width_m),
        start=float(scenery.runway_from_y_m),
        end=float(scenery.runway_to_y_m),
        aim=float(scenery.aim_mark_y_m),
        paint=_times(light, look.marking_bgr),
        edge_line=float(full or marking is Marking.EDGES),
        centre_line=float(full or marking is Marking.CENTRE),
        aim_blocks=float(full),
        end_bars=float(full or marking in (Marking.ENDS, Marking.CENTRE)),
        wear=look.wear,
        tyre_marks=look.tyre_marks,
        edge_width=look.paint.edge_width_m,
        dash=look.paint.dash_length_m,
        dash_every=look.paint.dash_every_m,
        dash_half_width=0.5 * look.paint.dash_width_m,
        dash_from=look.paint.dash_from_y_m,
        aim_length=look.paint.aim_length_m,
    )
