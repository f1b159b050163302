"""The ground of a rendered approach: a runway with its markings, taxiways, roads, fields."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray

Colour = tuple[float, float, float]
# columns of a painted patch: centre, unit vector of its length, half width, half length, colour, opacity, mottle,
# of dashes along the length: period (0 for none), share painted; and what it lies on: 0 the ground, 1 the ground, and
# it is the runway itself, 2 the runway, whose edges it may share
PATCH = (
    "cx", "cy", "ax", "ay", "half_width", "half_length", "r", "g", "b", "opacity", "mottle", "period", "share", "upon",
)  # fmt: skip
_GROUND, _RUNWAY, _ON_RUNWAY = 0.0, 1.0, 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Surfaces:
    """Reflectances (red, green, blue; 0 to 1) of an airfield."""

    ground: Colour = (0.27, 0.33, 0.16)
    ground_other: Colour = (0.38, 0.36, 0.20)
    runway: Colour = (0.30, 0.30, 0.31)
    runway_end: Colour = (0.48, 0.47, 0.44)
    paint: Colour = (0.85, 0.85, 0.82)
    taxiway: Colour = (0.34, 0.34, 0.34)
    road: Colour = (0.33, 0.31, 0.30)
    rubber: Colour = (0.10, 0.10, 0.10)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shadow:
    """A shadow on the ground: its middle, the direction of its length from the y axis, sides; what it takes, 0 to 1."""

    x_m: float
    y_m: float
    turn_rad: float
    width_m: float
    length_m: float
    darkness: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Strip:
    """A strip of other ground next to a runway: ploughed land, a track, a row of trees.

    Attributes
    ----------
    x_m, y_m, turn_rad : its middle, and the direction of its length from the y axis.
    width_m, length_m : its sides.
    colour, mottle : its reflectance, and its texture as a share of that.
    dashes : period along it, m, and the share of that which is covered; 0 m: all of it.
    """

    x_m: float
    y_m: float
    turn_rad: float
    width_m: float
    length_m: float
    colour: Colour
    mottle: float
    dashes: tuple[float, float] = (0.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Airfield:
    """An airfield in the threshold frame; lengths in m.

    Attributes
    ----------
    width_m, length_m : the runway, edge to edge and end to end; it lies at y from 0 to −length.
    end_m : length of the lighter slabs at both ends; 0 for none.
    edge_stripe_m : width of the painted edge lines; 0 for none.
    edge_stripe_inset_m : from a runway's edge inwards to the outer side of its line; 0: as in ICAO's Annex 14 (5.2.7).
    lamps_out_m : from a runway's edge outwards to its lamps; to 3 m in ICAO's Annex 14 (5.3.9.4).
    bars : painted bars on each half of a threshold.
    roads : (x, y, direction in rad from the y axis, width) of long straight roads.
    taxiway_side : +1 or −1: the side of the runway with taxiway and apron; 0 for none.
    repair : darkest and lightest stretch of newer or older pavement, against the runway's own.
    repair_tint : share of that which is independent in each colour; 0: all stretches are as grey as the runway.
    field_m : size of the fields' patchwork, 0 for none.
    grain : texture of the ground, as a share of its reflectance.
    paint_opacity, rubber_opacity : of all paint, 0 for none, and of the rubber at the touchdown.
    shadows : on top of all else.
    strips : under all else.
    """

    width_m: float = 18.0
    length_m: float = 500.0
    end_m: float = 50.0
    edge_stripe_m: float = 0.45
    edge_stripe_inset_m: float = 0.5
    lamps_out_m: float = 1.0
    bars: int = 4
    roads: tuple[tuple[float, float, float, float], ...] = ()
    taxiway_side: int = 1
    repair: tuple[float, float] = (0.72, 1.35)
    repair_tint: float = 1.0
    field_m: float = 90.0
    grain: float = 0.45
    paint_opacity: float = 0.9
    rubber_opacity: float = 0.3
    shadows: tuple[Shadow, ...] = ()
    strips: tuple[Strip, ...] = ()
    surfaces: Surfaces = Surfaces()


def patches(field: Airfield, generator: np.random.Generator) -> FloatArray:
    """Return the painted patches (n, 14), columns as in `PATCH`, in the order of painting."""
    s = field.surfaces
    middle = -0.5 * field.length_m
    rows: list[FloatArray] = [
        _patch(
            one.x_m, one.y_m, one.width_m, one.length_m, one.colour,
            turn=one.turn_rad, mottle=one.mottle, dashes=one.dashes,
        )
        for one in field.strips
    ]  # fmt: skip
    for x, y, turn, width in field.roads:
        rows.append(_patch(x, y, width, 4000.0, s.road, turn=turn, mottle=0.10))
        rows.append(_patch(x, y, 0.2, 4000.0, s.paint, turn=turn, opacity=0.7, dashes=(9.0, 0.4)))
    if field.taxiway_side:
        rows += _taxiways(field)
    rows.append(_patch(0.0, middle, field.width_m, field.length_m, s.runway, mottle=0.12, upon=_RUNWAY))
    rows += _repairs(field, generator)
    if field.end_m > 0.0:
        for y in (-0.5 * field.end_m, -field.length_m + 0.5 * field.end_m):
            rows.append(_patch(0.0, y, field.width_m, field.end_m, s.runway_end, mottle=0.08, upon=_ON_RUNWAY))
    for x in (-0.17 * field.width_m, 0.17 * field.width_m):
        opacity, width = field.rubber_opacity, 0.22 * field.width_m
        rows.append(_patch(x, -75.0, width, 90.0, s.rubber, opacity=opacity, mottle=0.3, upon=_ON_RUNWAY))
    if field.paint_opacity > 0.0:
        rows += _paint(field)
    for one in field.shadows:
        black = (0.0, 0.0, 0.0)
        rows.append(_patch(one.x_m, one.y_m, one.width_m, one.length_m, black, turn=one.turn_rad, opacity=one.darkness))
    return np.array(rows)


def _paint(field: Airfield) -> list[FloatArray]:
    """Return the painted centre line, side lines and bars."""
    paint, opacity, half, middle = field.surfaces.paint, field.paint_opacity, 0.5 * field.width_m, -0.5 * field.length_m
    rows = [
        _patch(0.0, middle, 0.4, field.length_m - 60.0, paint, opacity=opacity, dashes=(20.0, 0.6), upon=_ON_RUNWAY)
    ]
    if field.edge_stripe_m > 0.0:
        x = half - field.edge_stripe_inset_m - 0.5 * field.edge_stripe_m
        rows += [
            _patch(k * x, middle, field.edge_stripe_m, field.length_m, paint, opacity=opacity, upon=_ON_RUNWAY)
            for k in (-1, 1)
        ]
    pitch = (half - 1.5) / max(field.bars, 1)
    for k in range(field.bars):
        for sign in (-1.0, 1.0):
            for y in (-12.0, -field.length_m + 12.0):
                x = sign * (0.8 + (k + 0.5) * pitch)
                rows.append(_patch(x, y, 0.55 * pitch, 14.0, paint, opacity=opacity, upon=_ON_RUNWAY))
    return rows


def _repairs(field: Airfield, generator: np.random.Generator) -> list[FloatArray]:
    """Return stretches of newer and older asphalt: means that vary along the runway."""
    rows, y = [], -field.end_m
    while y > -field.length_m + field.end_m:
        length = float(generator.uniform(25.0, 70.0))
        factors = generator.uniform(*field.repair, 3)
        factors = factors[0] + field.repair_tint * (factors - factors[0])
        tone = tuple(float(np.clip(c * f, 0, 1)) for c, f in zip(field.surfaces.runway, factors, strict=True))
        rows.append(
            _patch(0.0, y - 0.5 * length, field.width_m, length, tone, mottle=0.12, upon=_ON_RUNWAY)  # type: ignore[arg-type]
        )
        y -= length
    return rows


def _taxiways(field: Airfield) -> list[FloatArray]:
    """Return a parallel taxiway, two links to the runway and an apron."""
    s, side = field.surfaces, float(field.taxiway_side)
    away = side * (0.5 * field.width_m + 32.0)
    rows = [_patch(away, -0.45 * field.length_m, 9.0, 0.9 * field.length_m, s.taxiway, mottle=0.1)]
    for y in (-0.06 * field.length_m, -0.55 * field.length_m):
        rows.append(_patch(0.5 * away, y, 9.0, abs(away), s.taxiway, turn=0.5 * np.pi, mottle=0.1))
    rows.append(_patch(away + side * 30.0, -0.6 * field.length_m, 45.0, 80.0, s.taxiway, mottle=0.1))
    rows.append(_patch(away, -0.45 * field.length_m, 0.2, 0.9 * field.length_m, (0.75, 0.6, 0.15)))
    return rows


def _patch(
    x: float,
    y: float,
    width: float,
    length: float,
    colour: Colour,
    *,
    turn: float = 0.0,
    opacity: float = 1.0,
    mottle: float = 0.0,
    dashes: tuple[float, float] = (0.0, 1.0),
    upon: float = _GROUND,
) -> FloatArray:
    """Return one patch; ``turn`` rad of its length from the y axis."""
    axis = (-np.sin(turn), np.cos(turn))
    return np.array([x, y, *axis, 0.5 * width, 0.5 * length, *colour, opacity, mottle, *dashes, upon])


def edge_lamps(field: Airfield, spacing_m: float = 30.0) -> FloatArray:
    """Return the runway's lamps (n, 6): place in m, colour; white along the edges, green and red at the ends."""
    half = 0.5 * field.width_m + field.lamps_out_m
    ys = np.arange(0.0, -field.length_m - 1.0, -spacing_m)
    lamps = [(x, y, 0.3, 1.0, 0.93, 0.75) for y in ys for x in (-half, half)]
    for x in np.linspace(-half, half, 7):
        lamps.append((float(x), 1.0, 0.3, 0.2, 1.0, 0.4))
        lamps.append((float(x), -field.length_m - 1.0, 0.3, 1.0, 0.15, 0.1))
    return np.array(lamps)
