"""Skies drawn at random: clouds, sun, haze, and the light that they give. Levels are by eye, after photographs."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.simulation.scenery.light import VISIBILITY_PER_EXTINCTION, Haze, SceneryLight, Sky
from groundstation.simulation.scenery.scenery import SkyName
from groundstation.simulation.scenery.surfaces import Colour

Span = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Weather:
    """Light and haze of a sky."""

    cloud_cover: float
    sun_azimuth_rad: float
    sun_elevation_rad: float
    sky: Sky
    haze: Haze
    light: SceneryLight


@dataclass(frozen=True, slots=True, kw_only=True)
class _SkyKind:
    """Distribution of the skies of a name: ranges of uniform draws.

    ``sun_deg`` is the elevation, ``azimuth_deg`` from the middle ``ahead_deg``; ``direct`` is the sun's share of the
    light and ``level`` what light there is on the ground, in full sunshine's.
    """

    cover: Span
    visibility_km: Span = (8.0, 20.0)
    sun_deg: Span = (18.0, 60.0)
    azimuth_deg: Span = (-180.0, 180.0)
    horizon: Colour = (228.0, 218.0, 208.0)
    zenith: Colour = (196.0, 146.0, 102.0)
    cloud: Colour = (236.0, 234.0, 232.0)
    base: Colour = (176.0, 168.0, 160.0)
    opacity: Span = (0.85, 1.0)
    softness: Span = (0.14, 0.30)
    relief: Span = (0.5, 0.9)
    glow: Span = (0.0, 0.0)
    disc: bool = False
    direct: Span = (0.50, 0.60)
    level: Span = (0.92, 1.05)
    shade: Span = (0.0, 0.0)
    top_m: Span = (100.0, 250.0)


_KINDS = {
    SkyName.CLEAR: _SkyKind(cover=(0.0, 0.05), opacity=(0.0, 0.4), visibility_km=(10.0, 20.0)),
    SkyName.FEW: _SkyKind(cover=(0.25, 0.4), visibility_km=(9.0, 20.0), shade=(0.0, 0.3)),
    SkyName.SCATTERED: _SkyKind(cover=(0.45, 0.6), shade=(0.2, 0.45)),
    SkyName.BROKEN: _SkyKind(
        cover=(0.7, 0.95),
        direct=(0.28, 0.45),
        shade=(0.3, 0.5),
        level=(0.8, 1.0),
        visibility_km=(6.0, 18.0),
        base=(150.0, 142.0, 134.0),
    ),
    SkyName.WHITE_OVERCAST: _SkyKind(
        cover=(1.0, 1.0),
        visibility_km=(3.0, 15.0),
        horizon=(226.0, 224.0, 221.0),
        zenith=(236.0, 234.0, 231.0),
        base=(206.0, 203.0, 200.0),
        softness=(0.5, 0.9),
        relief=(0.2, 0.7),
        direct=(0.0, 0.08),
        level=(0.78, 0.95),
    ),
    SkyName.DARK_OVERCAST: _SkyKind(
        cover=(1.0, 1.0),
        visibility_km=(2.5, 12.0),
        horizon=(168.0, 164.0, 160.0),
        zenith=(132.0, 126.0, 120.0),
        cloud=(158.0, 153.0, 148.0),
        base=(104.0, 99.0, 94.0),
        softness=(0.3, 0.7),
        relief=(0.6, 1.0),
        direct=(0.0, 0.02),
        level=(0.42, 0.62),
    ),
    SkyName.DUSK: _SkyKind(
        cover=(0.1, 0.8),
        visibility_km=(4.0, 15.0),
        sun_deg=(0.8, 4.0),
        horizon=(120.0, 158.0, 208.0),
        zenith=(128.0, 84.0, 62.0),
        cloud=(118.0, 128.0, 170.0),
        base=(96.0, 82.0, 84.0),
        glow=(20.0, 60.0),
        direct=(0.20, 0.35),
        level=(0.28, 0.45),
    ),
    SkyName.SUN_AHEAD: _SkyKind(
        cover=(0.0, 0.6),
        visibility_km=(4.0, 20.0),
        sun_deg=(2.5, 14.0),
        azimuth_deg=(-12.0, 12.0),
        horizon=(206.0, 214.0, 220.0),
        zenith=(190.0, 150.0, 116.0),
        cloud=(220.0, 226.0, 232.0),
        glow=(90.0, 190.0),
        disc=True,
        level=(0.6, 0.85),
    ),
    SkyName.SUN_BEHIND: _SkyKind(
        cover=(0.0, 0.5), sun_deg=(8.0, 30.0), azimuth_deg=(140.0, 220.0), level=(0.9, 1.05), direct=(0.55, 0.65)
    ),
    SkyName.HAZY: _SkyKind(
        cover=(0.0, 0.6),
        visibility_km=(1.5, 4.0),
        horizon=(206.0, 206.0, 204.0),
        zenith=(212.0, 190.0, 168.0),
        glow=(0.0, 50.0),
        direct=(0.25, 0.45),
        level=(0.75, 0.95),
        top_m=(400.0, 900.0),
    ),
}


def draw_weather(generator: np.random.Generator, name: SkyName) -> Weather:
    """Draw a sky of this kind with the sun, haze and light that belong to it."""
    kind = _KINDS[name]

    def drawn(span: Span) -> float:
        return float(generator.uniform(*span))

    elevation = math.radians(drawn(kind.sun_deg))
    azimuth = math.radians(drawn(kind.azimuth_deg))
    # the haze is thick as often as thin
    visibility_m = 1000.0 * math.exp(drawn((math.log(kind.visibility_km[0]), math.log(kind.visibility_km[1]))))
    bright = float(generator.normal(0.0, 0.03))
    horizon = _scaled(kind.horizon, 1.0 + bright)
    sky = Sky(
        horizon_bgr=horizon,
        zenith_bgr=_scaled(kind.zenith, 1.0 + bright),
        gradient_rad=drawn((0.16, 0.34)),
        cloud_bgr=_scaled(kind.cloud, 1.0 + bright),
        cloud_base_bgr=_scaled(kind.base, 1.0 + bright),
        cloud_opacity=drawn(kind.opacity),
        cloud_relief=max(drawn(kind.relief), 0.01),
        cloud_size=drawn((0.5, 1.3)),
        cloud_softness=drawn(kind.softness),
        clouds_from_rad=drawn((-0.06, 0.01)),
        sun_glow=drawn(kind.glow),
        sun_disc=kind.disc,
    )
    return Weather(
        cloud_cover=drawn(kind.cover),
        sun_azimuth_rad=azimuth,
        sun_elevation_rad=elevation,
        sky=sky,
        haze=Haze(
            extinction_m=visibility_m / VISIBILITY_PER_EXTINCTION,
            air_light_bgr=_scaled(horizon, 0.94),
            top_m=drawn(kind.top_m),
        ),
        light=_light(drawn(kind.direct), drawn(kind.level), drawn(kind.shade), elevation),
    )


def _light(direct: float, level: float, cloud_shadow: float, elevation: float) -> SceneryLight:
    """Return light with a share from the sun; a low sun is red, and its shade is blue."""
    low = math.exp(-elevation / math.radians(9.0))
    sun = np.array([1.0 - 0.55 * low, 1.0 - 0.22 * low, 1.0 + 0.05 * low])
    sky = np.array([1.0 + 0.16 * direct, 1.0, 1.0 - 0.12 * direct])
    rest = 1.0 - direct
    tint = direct * sun + rest * sky
    return SceneryLight(
        ambient_bgr=_colour(level * 0.66 * rest * sky),
        from_sky_bgr=_colour(level * 0.34 * rest * sky),
        sun_bgr=_colour(level * direct * sun),
        ground_bgr=_colour(level * tint),
        # on level ground a low sun adds little to the sky's light, but to the eye its shadows are dark
        shadow=min(1.1 * direct, 0.7),
        cloud_shadow=min(cloud_shadow, direct),
    )


def _scaled(colour: Colour, factor: float) -> Colour:
    return _colour(np.clip(np.array(colour) * factor, 0.0, 255.0))


def _colour(values: np.ndarray) -> Colour:
    b, g, r = (float(v) for v in values)
    return b, g, r
