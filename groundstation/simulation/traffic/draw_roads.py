"""Roads with cars drawn at random: along the runway or across beyond its end, clear of all objects."""

import math

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.scenery import Scenery
from groundstation.simulation.scenery.scenery_objects import ObjectKind
from groundstation.simulation.scenery.surfaces import Colour, Surface
from groundstation.simulation.traffic.sight_lines import SightLines
from groundstation.simulation.traffic.traffic_spec import CarKind, CarSpec, RoadSpec

SPEED_M_S = (5.0, 20.0)
# of cars, those that pass under or behind the aircraft as seen from a station
ENCOUNTERS = 0.6
_ACROSS = 0.45
_CARS = (1, 5)
_TRIES = 40
_STEP_M = 4.0
_FROM_RUNWAY_M, _FROM_STATION_M, _FROM_OBJECT_M = 10.0, 9.0, 1.5
_PAINTS: tuple[Colour, ...] = (
    (196.0, 200.0, 204.0),
    (232.0, 233.0, 234.0),
    (150.0, 152.0, 154.0),
    (84.0, 82.0, 80.0),
    (36.0, 34.0, 34.0),
    (44.0, 38.0, 150.0),
    (120.0, 66.0, 34.0),
    (62.0, 84.0, 58.0),
    (70.0, 150.0, 190.0),
)
# wires are high above
_OVERHEAD = (ObjectKind.WIRE,)


def draw_roads(generator: np.random.Generator, lines: SightLines, scenery: Scenery) -> tuple[RoadSpec, ...]:
    """Draw a road with cars; none where there is no room for one."""
    for _ in range(_TRIES):
        road = _road(generator, lines.duration_s, scenery)
        if _is_clear(road, lines, scenery):
            count = int(generator.integers(_CARS[0], _CARS[1] + 1))
            cars = tuple(_car(generator, lines, road) for _ in range(count))
            return (
                RoadSpec(
                    surface=road.surface,
                    x_m=road.x_m,
                    y_m=road.y_m,
                    heading_rad=road.heading_rad,
                    length_m=road.length_m,
                    width_m=road.width_m,
                    cars=cars,
                ),
            )
    return ()


def _road(generator: np.random.Generator, duration_s: float, scenery: Scenery) -> RoadSpec:
    """Draw a road without cars; the fastest car can drive on it for the whole session."""
    half, end = scenery.runway_half_width_m, scenery.runway_to_y_m
    length = SPEED_M_S[1] * duration_s + float(generator.uniform(300.0, 900.0))
    paved = float(generator.uniform()) < 0.8
    if float(generator.uniform()) < _ACROSS:
        x, y = (
            float(generator.normal(0.0, 60.0)),
            end + math.exp(float(generator.uniform(math.log(30.0), math.log(400.0)))),
        )
        heading = 0.5 * math.pi + float(generator.normal(0.0, 0.12))
    else:
        side = -1.0 if float(generator.uniform()) < 0.5 else 1.0
        x = side * (half + math.exp(float(generator.uniform(math.log(16.0), math.log(160.0)))))
        y = float(generator.uniform(0.2, 0.5)) * length
        heading = float(generator.normal(0.0, 0.02))
    return RoadSpec(
        surface=Surface.ASPHALT if paved else Surface.GRAVEL,
        x_m=x,
        y_m=y,
        heading_rad=heading,
        length_m=length,
        width_m=float(generator.uniform(4.6, 7.0)),
    )


def _is_clear(road: RoadSpec, lines: SightLines, scenery: Scenery) -> bool:
    """Return whether a road is free of objects, water, runway and stations."""
    along = np.arange(-0.5 * road.length_m, 0.5 * road.length_m, _STEP_M)
    middle = np.column_stack(
        [road.x_m + along * math.sin(road.heading_rad), road.y_m + along * math.cos(road.heading_rad)]
    )
    half = 0.5 * road.width_m
    from_runway = np.abs(middle[:, 0]) - scenery.runway_half_width_m
    alongside = (middle[:, 1] > scenery.runway_from_y_m - 10.0) & (middle[:, 1] < scenery.runway_to_y_m + 10.0)
    if np.any(alongside & (from_runway < half + _FROM_RUNWAY_M)):
        return False
    for eye in lines.eyes_m:
        if np.linalg.norm(middle - eye[:2], axis=1).min() < half + _FROM_STATION_M:
            return False
    for thing in scenery.objects:
        sizes = (thing.length_m, thing.width_m)
        room = half + _FROM_OBJECT_M
        if thing.kind not in _OVERHEAD and _on_rectangle(
            middle, (thing.x_m, thing.y_m), thing.heading_rad, sizes, room
        ):
            return False
    for patch in scenery.patches:
        sizes = (patch.length_m, patch.width_m)
        wet, room = patch.surface is Surface.WATER, half + patch.ragged_m
        if wet and _on_rectangle(middle, (patch.x_m, patch.y_m), patch.heading_rad, sizes, room):
            return False
    return True


def _on_rectangle(
    points: FloatArray, place: tuple[float, float], heading_rad: float, size: tuple[float, float], room: float
) -> bool:
    """Return whether any of points (n, 2) m is within so much of a rectangle of length and width."""
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    x, y = points[:, 0] - place[0], points[:, 1] - place[1]
    near = (np.abs(x * sine + y * cosine) < 0.5 * size[0] + room) & (
        np.abs(x * cosine - y * sine) < 0.5 * size[1] + room
    )
    return bool(near.any())


def _car(generator: np.random.Generator, lines: SightLines, road: RoadSpec) -> CarSpec:
    """Draw a car that stays on its road; sometimes in line with the aircraft as seen from a station."""
    speed = float(generator.uniform(*SPEED_M_S)) * (-1.0 if float(generator.uniform()) < 0.5 else 1.0)
    travel = speed * lines.duration_s
    low, high = -0.5 * road.length_m - min(travel, 0.0), 0.5 * road.length_m - max(travel, 0.0)
    start = float(generator.uniform(low, high))
    sight = lines.draw(math.radians(1.5))
    if float(generator.uniform()) < ENCOUNTERS:
        met = _along_where_crossed(road, sight.eye_m, sight.towards)
        wanted = math.nan if met is None else met - speed * sight.t_s
        start = wanted if low <= wanted <= high else start
    kind = (CarKind.CAR, CarKind.CAR, CarKind.ESTATE, CarKind.VAN)[int(generator.integers(4))]
    van = kind is CarKind.VAN
    b, g, r = _PAINTS[int(generator.integers(len(_PAINTS)))]
    shade = float(generator.uniform(0.85, 1.08))
    return CarSpec(
        kind=kind,
        length_m=float(generator.uniform(4.9, 6.6) if van else generator.uniform(3.9, 4.9)),
        width_m=float(generator.uniform(1.9, 2.1) if van else generator.uniform(1.68, 1.9)),
        height_m=float(generator.uniform(2.0, 2.7) if van else generator.uniform(1.4, 1.65)),
        colour_bgr=(min(shade * b, 255.0), min(shade * g, 255.0), min(shade * r, 255.0)),
        along_m=start,
        speed_m_s=speed,
    )


def _along_where_crossed(road: RoadSpec, eye_m: FloatArray, towards: FloatArray) -> float | None:
    """Return where on a road a direction's vertical plane crosses it, m from its middle; None where it does not."""
    sine, cosine = math.sin(road.heading_rad), math.cos(road.heading_rad)
    across = towards[0] * cosine - towards[1] * sine
    if abs(across) < 1e-6:
        return None
    x, y = road.x_m - float(eye_m[0]), road.y_m - float(eye_m[1])
    away = (x * cosine - y * sine) / across
    if away <= 0.0:
        return None
    return float((away * towards[0] - x) * sine + (away * towards[1] - y) * cosine)
