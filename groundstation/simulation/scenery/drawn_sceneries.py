"""`draw_scenery`: a whole scenery at random, from the kinds of surroundings and of skies that are allowed."""

import math
from collections.abc import Sequence

import numpy as np

from groundstation.errors import ScenarioError
from groundstation.simulation.scenery.drawn_objects import ObjectPlan
from groundstation.simulation.scenery.drawn_sites import SITES, SiteKind
from groundstation.simulation.scenery.drawn_skies import Weather, draw_weather
from groundstation.simulation.scenery.scenery import Marking, RunwayLook, Scenery, SceneryName, Skyline, SkyName
from groundstation.simulation.scenery.surfaces import Colour, GroundPatch, Surface

SCENERIES = tuple(SceneryName)
SKIES = tuple(SkyName)
_UNPAVED = (Surface.SHORT_GRASS, Surface.GRAVEL, Surface.SAND, Surface.PACKED_SNOW)
_SEEDS = 1 << 30


def draw_scenery(
    generator: np.random.Generator,
    sceneries: Sequence[SceneryName] = SCENERIES,
    skies: Sequence[SkyName] = SKIES,
) -> Scenery:
    """Draw surroundings and a sky of the allowed kinds; the same state of the generator gives the same scenery.

    Raises `ScenarioError` where no kind is allowed.
    """
    for where, names in (("sceneries", sceneries), ("skies", skies)):
        if not names:
            raise ScenarioError(f"draw_scenery: {where}", got="none", wanted="one or more names")
    name = SceneryName(sceneries[int(generator.integers(len(sceneries)))])
    sky = SkyName(skies[int(generator.integers(len(skies)))])
    weather = draw_weather(generator, sky)
    site = SITES[name]
    ground = site.grounds[int(generator.integers(len(site.grounds)))]
    half, start, length = (
        float(generator.uniform(*site.half_width_m)),
        float(generator.uniform(5.0, 25.0)),
        float(generator.uniform(*site.length_m)),
    )
    end, aim = start + length, min(float(generator.uniform(80.0, 200.0)), start + 0.6 * length)
    plan = ObjectPlan(generator, site, half, end, aim)
    return Scenery(
        seed=int(generator.integers(_SEEDS)),
        runway_half_width_m=half,
        runway_from_y_m=start,
        runway_to_y_m=end,
        aim_mark_y_m=aim,
        cloud_cover=weather.cloud_cover,
        sun_azimuth_rad=weather.sun_azimuth_rad,
        sun_elevation_rad=weather.sun_elevation_rad,
        drawn_scenery=name,
        drawn_sky=sky,
        ground=ground,
        ground_tint_bgr=_tint(generator, 0.02 if ground is Surface.SNOW else 0.09),
        mosaic=float(generator.uniform(*site.mosaic)),
        runway=_runway(generator, site),
        skyline=_skyline(generator, site, weather),
        sky=weather.sky,
        haze=weather.haze,
        light=weather.light,
        patches=_patches(generator, name, site, half, end),
        objects=plan.objects(),
    )


def _tint(generator: np.random.Generator, sigma: float) -> Colour:
    """Draw factors around 1: brightness first, and half as much of each colour."""
    bright = float(generator.normal(0.0, sigma))
    b, g, r = np.exp(bright + generator.normal(0.0, 0.5 * sigma, 3))
    return float(b), float(g), float(r)


def _runway(generator: np.random.Generator, site: SiteKind) -> RunwayLook:
    surface = site.runways[int(generator.integers(len(site.runways)))]
    marks = list(Marking)
    paved = surface not in _UNPAVED
    marking = marks[int(generator.choice(len(marks), p=(0.4, 0.2, 0.15, 0.15, 0.1)))] if paved else Marking.NONE
    fresh = surface is Surface.FRESH_ASPHALT
    return RunwayLook(
        surface=surface,
        tint_bgr=_tint(generator, 0.08),
        marking=marking,
        marking_bgr=(120.0, 206.0, 216.0) if generator.random() < 0.1 else (205.0, 206.0, 207.0),
        wear=0.0 if fresh else float(generator.uniform(0.0, 0.9)),
        tyre_marks=float(generator.uniform(0.0, 0.7)) if paved and not fresh else 0.0,
    )


def _skyline(generator: np.random.Generator, site: SiteKind, weather: Weather) -> Skyline:
    relief = float(generator.uniform(*site.relief_rad))
    green = float(generator.uniform(0.0, 1.0))
    hills = np.array([74.0, 92.0, 84.0]) + green * np.array([16.0, 6.0, 34.0])
    if site.snow:
        hills = np.array([186.0, 180.0, 174.0])
    elif Surface.SAND in site.grounds and len(site.grounds) == 1:
        hills = np.array([104.0, 124.0, 142.0])
    # hills that rise high are near
    mean = float(generator.uniform(*site.hills_rad))
    far = float(generator.uniform(0.6, 1.6)) * 6000.0 / (1.0 + 12.0 * max(mean, 0.0))
    trees = np.array([48.0, 76.0, 62.0]) if not site.snow else np.array([104.0, 110.0, 106.0])
    return Skyline(
        trees_m=max(float(generator.uniform(700.0, 1500.0)), 0.0),
        trees_height_m=float(generator.uniform(9.0, 18.0)),
        trees_gap=float(generator.uniform(*site.trees_gap)),
        trees_bgr=(float(trees[0]), float(trees[1]), float(trees[2])),
        trees_solid=True,
        hills_rad=mean,
        hills_relief_rad=relief,
        hills_detail_rad=0.35 * relief,
        hills_bgr=(float(hills[0]), float(hills[1]), float(hills[2])),
        hills_m=far,
    )


def _patches(
    generator: np.random.Generator, name: SceneryName, site: SiteKind, half: float, end: float
) -> tuple[GroundPatch, ...]:
    """Draw fields, lakes, roads and aprons next to the runway."""
    side = -1.0 if generator.random() < 0.5 else 1.0
    if name is SceneryName.COAST:
        return _shore(generator, side * (half + float(generator.uniform(40.0, 160.0))), side)
    found = []
    for surface in site.patches:
        side = -side
        off = half + float(generator.uniform(14.0, 60.0))
        if surface in (Surface.ASPHALT, Surface.CONCRETE) and generator.random() < 0.7:
            # a taxiway or a road along the runway
            width = float(generator.uniform(4.0, 14.0))
            found.append(_patch(generator, surface, (side * (off + width), 0.5 * end), 0.0, (1.2 * end, width), 0.0))
            continue
        length, width = float(generator.uniform(80.0, 400.0)), float(generator.uniform(50.0, 260.0))
        wet = surface is Surface.WATER
        place = (side * (off + 0.5 * width + (25.0 if wet else 0.0)), float(generator.uniform(60.0, 500.0)))
        ragged = 0.06 * width if wet else 0.8
        found.append(_patch(generator, surface, place, float(generator.normal(0.0, 0.06)), (length, width), ragged))
    return tuple(found)


def _shore(generator: np.random.Generator, shore_x_m: float, side: float) -> tuple[GroundPatch, ...]:
    """Return a beach along the runway and the sea behind it, to beyond the horizon."""
    beach = float(generator.uniform(10.0, 60.0))
    reach = 60_000.0
    heading = float(generator.normal(0.0, 0.05))
    out = side * 0.5 * reach
    return (
        _patch(generator, Surface.SAND, (shore_x_m + out, 300.0), heading, (reach, reach + 2.0 * beach), 6.0),
        _patch(generator, Surface.WATER, (shore_x_m + out, 300.0), heading, (reach, reach), 6.0),
    )


def _patch(
    generator: np.random.Generator,
    surface: Surface,
    place: tuple[float, float],
    heading: float,
    size: tuple[float, float],
    ragged: float,
) -> GroundPatch:
    return GroundPatch(
        surface=surface,
        x_m=place[0],
        y_m=place[1],
        heading_rad=math.remainder(heading, math.tau),
        length_m=size[0],
        width_m=size[1],
        tint_bgr=_tint(generator, 0.06),
        ragged_m=ragged,
    )
