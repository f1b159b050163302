"""Light, haze and the camera's noise over an airfield, drawn."""

import math
from dataclasses import dataclass, replace

import numpy as np

from groundstation.onboard.scenes.drawn_airfield import picked
from groundstation.onboard.scenes.ground import Surfaces
from groundstation.onboard.scenes.light import DAY, DUSK, HAZE, NIGHT, Light

_LIGHTS = {
    "day": DAY,
    "low sun": replace(DAY, sun=(1.0, 0.82, 0.58), haze=(0.72, 0.66, 0.62), visibility_m=4000.0),
    "haze": HAZE,
    "night": NIGHT,
    "dusk": DUSK,
}
# how often each occurs; dusk in the test set alone
_SHARES = {"day": 0.4, "low sun": 0.15, "haze": 0.2, "night": 0.1, "dusk": 0.15}
_LAMPS_LIT = {"day": 0.1, "low sun": 0.2, "haze": 0.6, "dusk": 0.8, "night": 1.0}
# reflectance that the exposure of `Light` is for
_USUAL_GREY = 0.31


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnLight:
    """A light, and what was drawn in words."""

    light: Light
    factors: dict[str, str]


def draw_light(generator: np.random.Generator, surfaces: Surfaces, *, dusk: bool, lamps: bool) -> DrawnLight:
    """Draw a light; ``dusk``: whether it may be; ``lamps``: whether the runway has any, by night all have."""
    name = picked(generator, {k: v for k, v in _SHARES.items() if dusk or k != "dusk"})
    usual = _LIGHTS[name]
    lit = bool(generator.uniform() < _LAMPS_LIT[name]) and (lamps or name == "night")
    power = (usual.lamp_power or 6000.0) * float(np.exp(generator.normal(0.0, 0.4)))
    grey = 0.7 * float(np.mean(surfaces.ground)) + 0.3 * float(np.mean(surfaces.runway))
    # automatic exposure, mostly about right
    gain = usual.gain * (_USUAL_GREY / grey) ** 0.8 * float(np.exp(generator.normal(0.0, 0.15)))
    shadow = float(generator.choice([0.0, 0.2, generator.uniform(0.2, 0.7)]))
    across, along = (float(one) for one in np.exp(generator.uniform(math.log(50.0), math.log(300.0), 2)))
    visibility = usual.visibility_m * float(np.exp(generator.uniform(-0.5, 0.7)))
    light = replace(
        usual,
        visibility_m=visibility,
        cloud_shadow=shadow,
        cloud_m=(across, along),
        skyline_rad=float(generator.uniform(0.0, 0.03)),
        fall=usual.fall * float(generator.uniform(-1.0, 1.0)),
        lamp_power=power if lit else 0.0,
        gain=gain,
        noise=usual.noise * float(np.exp(generator.uniform(-0.5, 0.7))),
        shot_noise=usual.shot_noise * float(np.exp(generator.uniform(-0.5, 0.7))),
        blur_px=float(generator.uniform(0.4, 1.1)),
    )
    factors = {
        "light": name,
        "lamps": "lit" if lit else "dark",
        "cloud shadows": "strong" if shadow > 0.3 else "few",
    }
    return DrawnLight(light=light, factors=factors)
