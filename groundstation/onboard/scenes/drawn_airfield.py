"""A runway and its surroundings, drawn: width, surface, ground, paint, lamps, roads, taxiways, wet, shadows."""

import math
from dataclasses import dataclass, replace

import numpy as np

from groundstation.onboard.scenes.bright_grounds import (
    BRIGHT,
    BRIGHT_SHARES,
    SURFACE_SHARES,
    blown_over,
    borders,
    graded,
)
from groundstation.onboard.scenes.ground import Airfield, Colour, Shadow, Surfaces

_GRASS = {"grass": ((0.20, 0.28, 0.11), (0.30, 0.37, 0.19)), "dry": ((0.40, 0.36, 0.20), (0.50, 0.44, 0.27))}
_BARE = {"sand": ((0.50, 0.42, 0.28), (0.64, 0.54, 0.38)), "snow": ((0.74, 0.76, 0.79), (0.82, 0.83, 0.86))}
_GROUNDS = {**_GRASS, **_BARE, **BRIGHT}
# how often each occurs; snow in the test set alone
_GROUND_SHARES = {"grass": 0.5, "dry": 0.2, "sand": 0.15, "snow": 0.15}
_UNPAVED = ("grass", "graded")
_SURFACE_SHARES = {"asphalt": 0.45, "concrete": 0.35, "grass": 0.2}
_PAINT_SHARES = {"whole": 0.4, "worn": 0.35, "missing": 0.25}
# widths are announced right in so many of them, and otherwise wrong by up to so much
_RIGHT, _WRONG = 0.6, 0.25
_WIDE_M = 30.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnAirfield:
    """An airfield, the width that is announced of its runway, whether it has lamps, and what was drawn in words."""

    airfield: Airfield
    announced_m: float
    lamps: bool
    factors: dict[str, str]


def draw_airfield(generator: np.random.Generator, *, snow: bool, bright: bool = False) -> DrawnAirfield:
    """Draw an airfield; ``snow``: whether it may lie there; ``bright``: on ground as bright as pavement or brighter."""
    shares = BRIGHT_SHARES if bright else {k: v for k, v in _GROUND_SHARES.items() if snow or k != "snow"}
    ground = picked(generator, shares)
    surface = picked(generator, SURFACE_SHARES if bright else _SURFACE_SHARES)
    paint = picked(generator, _PAINT_SHARES)
    paint = "missing" if surface in _UNPAVED else paint
    wet, lamps = bool(generator.uniform() < 0.2), bool(generator.uniform() < 0.5)
    width = float(np.exp(generator.uniform(math.log(15.0), math.log(60.0))))
    length = float(np.clip(width * generator.uniform(22.0, 45.0), 400.0, 2500.0))
    announced = width
    if generator.uniform() > _RIGHT:
        announced *= 1.0 + float(generator.uniform(-_WRONG, _WRONG))
    off = abs(announced / width - 1.0)
    side = int(generator.choice([-1, 0, 0, 1]))
    roads, crossing = _roads(generator, width, length, side)
    shadows = _shadows(generator, width, length)
    airfield = Airfield(
        width_m=width,
        length_m=length,
        end_m=float(generator.choice([0.0, 50.0])) if surface not in _UNPAVED else 0.0,
        edge_stripe_m=_stripe_m(generator, width, paint),
        edge_stripe_inset_m=float(generator.choice([0.0, 0.5, generator.uniform(0.0, 1.0)])),
        lamps_out_m=float(generator.uniform(0.8, 3.0)),
        bars=int(generator.integers(3, 7)),
        roads=roads,
        taxiway_side=side,
        repair=(0.72, 1.35) if surface not in _UNPAVED else (0.92, 1.08),
        repair_tint=float(generator.choice([0.0, 1.0])),
        field_m=float(generator.choice([0.0, generator.uniform(60.0, 300.0)])),
        paint_opacity={"whole": 0.9, "worn": float(generator.uniform(0.12, 0.5)), "missing": 0.0}[paint],
        rubber_opacity=float(generator.uniform(0.0, 0.6)) if surface not in _UNPAVED else 0.1,
        shadows=shadows,
        grain=float(generator.uniform(*_grain_of(ground))),
        surfaces=_surfaces(generator, surface, ground, wet=wet),
    )
    border = "none"
    if bright:
        border, strips = borders(generator, width, airfield.surfaces.ground)
        airfield = replace(airfield, strips=strips)
    factors = {
        "surface": surface,
        "ground": ground,
        "paint": paint,
        "width": f"{'below' if width < _WIDE_M else 'above'} {_WIDE_M:.0f} m",
        "announced width": "right" if off == 0.0 else f"wrong by {'less' if off < 0.1 else 'more'} than 10 %",
        "wet": "wet" if wet else "dry",
        "shadows": "shadows" if shadows else "none",
        "crossing road": "crossing" if crossing else "none",
        "taxiway": "taxiway" if side else "none",
        **({"border": border} if bright else {}),
    }
    return DrawnAirfield(airfield=airfield, announced_m=announced, lamps=lamps, factors=factors)


def _grain_of(ground: str) -> tuple[float, float]:
    """Return between which values a ground's texture is, as a share of its reflectance."""
    if ground == "snow":
        return 0.05, 0.2
    return (0.05, 0.35) if ground in BRIGHT else (0.2, 0.6)


def picked(generator: np.random.Generator, shares: dict[str, float]) -> str:
    """Return one of the names, each as often as its share of all has it."""
    weights = np.array(list(shares.values()))
    return list(shares)[int(generator.choice(len(shares), p=weights / weights.sum()))]


def _stripe_m(generator: np.random.Generator, width_m: float, paint: str) -> float:
    """Return the width of the painted side lines; 0 for none."""
    usual = float(generator.choice([0.3, 0.45]))
    if paint == "missing" or generator.uniform() < 0.15:
        return 0.0
    return 0.9 if width_m >= _WIDE_M else usual


def _between(generator: np.random.Generator, colours: tuple[Colour, Colour]) -> Colour:
    """Return a colour between two, each part near the others' place."""
    low, high = (np.array(one) for one in colours)
    share = np.clip(generator.uniform() + generator.normal(0.0, 0.08, 3), 0.0, 1.0)
    red, green, blue = (float(one) for one in low + share * (high - low))
    return red, green, blue


def _surfaces(generator: np.random.Generator, surface: str, ground: str, *, wet: bool) -> Surfaces:
    """Return the reflectances; what is wet is darker, and snow lies on the runway too, as much of it as is left."""
    own = _between(generator, _GROUNDS[ground])
    other = _between(generator, _GROUNDS[ground])
    if surface == "graded":
        runway = graded(generator, own)
    elif surface == "grass":
        runway = _scaled(_between(generator, _GRASS["grass"]), float(generator.uniform(0.8, 1.3)))
    elif surface == "asphalt":
        runway = _between(generator, ((0.10, 0.10, 0.11), (0.26, 0.26, 0.26)))
    else:
        runway = _between(generator, ((0.34, 0.33, 0.31), (0.54, 0.53, 0.49)))
    end = _scaled(runway, float(generator.uniform(0.9, 1.5)))
    if ground == "snow" or ground in BRIGHT:
        left = blown_over(generator)
        runway, end = (_mixed(one, own, left) for one in (runway, end))
    if wet:
        runway, end, own, other = _scaled(runway, 0.6), _scaled(end, 0.6), _scaled(own, 0.85), _scaled(other, 0.85)
    taxiway = _scaled(runway, float(generator.uniform(0.8, 1.3)))
    return Surfaces(ground=own, ground_other=other, runway=runway, runway_end=end, taxiway=taxiway)


def _scaled(colour: Colour, by: float) -> Colour:
    red, green, blue = (min(by * one, 0.95) for one in colour)
    return red, green, blue


def _mixed(colour: Colour, other: Colour, share: float) -> Colour:
    red, green, blue = (a + share * (b - a) for a, b in zip(colour, other, strict=True))
    return red, green, blue


def _roads(
    generator: np.random.Generator, width_m: float, length_m: float, side: int
) -> tuple[tuple[tuple[float, float, float, float], ...], bool]:
    """Return a road along the runway and one across it or before it, each in some of the worlds; whether it crosses."""
    roads, crossing = [], bool(generator.uniform() < 0.3)
    along = bool(generator.uniform() < 0.5)
    away = 0.5 * width_m + float(generator.uniform(20.0, 60.0))
    where = (
        float(generator.uniform(-200.0, 0.0)),
        float(generator.normal(0.0, 0.05)),
        float(generator.uniform(6.0, 10.0)),
    )
    if along:
        roads.append((-(side or 1) * away, *where))
    before = float(generator.uniform(20.0, 120.0)), math.pi / 2.0 + float(generator.normal(0.0, 0.15))
    across_m, at = float(generator.uniform(6.0, 12.0)), -float(generator.uniform(0.1, 0.6)) * length_m
    if crossing:
        roads.append((0.0, at, before[1], across_m))
    elif generator.uniform() < 0.5:
        roads.append((0.0, before[0], before[1], across_m))
    return tuple(roads), crossing


def _shadows(generator: np.random.Generator, width_m: float, length_m: float) -> tuple[Shadow, ...]:
    """Return shadows of trees and buildings that reach over an edge."""
    count = int(generator.integers(1, 5)) if generator.uniform() < 0.3 else 0
    return tuple(
        Shadow(
            x_m=float(generator.choice([-1.0, 1.0])) * (0.5 * width_m + float(generator.uniform(-6.0, 10.0))),
            y_m=-float(generator.uniform(0.0, 0.6)) * length_m,
            turn_rad=math.pi / 2.0 + float(generator.uniform(-0.7, 0.7)),
            width_m=float(generator.uniform(6.0, 30.0)),
            length_m=float(generator.uniform(16.0, 45.0)),
            darkness=float(generator.uniform(0.3, 0.65)),
        )
        for _ in range(count)
    )
