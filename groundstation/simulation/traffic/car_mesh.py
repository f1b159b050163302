"""Shapes of cars: a lower body with wheels, and a glazed cabin with a roof, of given sizes."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.airframe import Airframe
from groundstation.simulation.airframes.mesh import MeshPart, assembled, loft, part, wheel
from groundstation.simulation.traffic.traffic_spec import CarKind, CarSpec

_GLASS, _TYRE, _UNDER = (66.0, 58.0, 50.0), (28.0, 28.0, 28.0), (18.0, 18.0, 18.0)
_HEADLAMP, _REAR_LAMP = (225.0, 228.0, 230.0), (34.0, 34.0, 170.0)
_CLEARANCE_M, _WHEEL_RADIUS_M, _WHEEL_HALF_WIDTH_M = 0.2, 0.31, 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class _Outline:
    """Heights as shares of the car's height and lengths as shares of its length, from its front.

    ``bonnet`` and ``boot`` are the heights of front and rear, ``waist`` that of the windows' lower edge; the cabin
    stands on the waist from ``cabin[0]`` to ``cabin[1]``, the roof is from ``roof[0]`` to ``roof[1]``.
    """

    bonnet: float
    waist: float
    boot: float
    cabin: tuple[float, float]
    roof: tuple[float, float]
    inset: float


# after side views of a saloon, an estate car and a delivery van
_OUTLINES = {
    CarKind.CAR: _Outline(bonnet=0.52, waist=0.62, boot=0.60, cabin=(0.27, 0.88), roof=(0.43, 0.72), inset=0.13),
    CarKind.ESTATE: _Outline(bonnet=0.54, waist=0.60, boot=0.60, cabin=(0.27, 0.99), roof=(0.42, 0.94), inset=0.12),
    CarKind.VAN: _Outline(bonnet=0.46, waist=0.54, boot=0.56, cabin=(0.10, 0.30), roof=(0.22, 0.30), inset=0.08),
}


def car_mesh(car: CarSpec) -> Airframe:
    """Return a car; its origin is the middle of its foot on the ground."""
    length, height = car.length_m, car.height_m
    half, lines = 0.5 * car.width_m, _OUTLINES[car.kind]
    low, waist, bonnet, boot = _CLEARANCE_M, lines.waist * height, lines.bonnet * height, lines.boot * height
    cabin = [length * (share - 0.5) for share in lines.cabin]
    roof = [length * (share - 0.5) for share in lines.roof]
    front, rear = -0.5 * length, 0.5 * length
    lower = [
        _section(front, 0.86 * half, low + 0.08, 0.82 * bonnet),
        _section(front + 0.04 * length, half, low, bonnet),
        _section(cabin[0], half, low, waist),
        _section(min(cabin[1], rear - 0.05 * length), half, low, waist),
        _section(rear - 0.02 * length, half, low, boot),
        _section(rear, 0.88 * half, low + 0.1, 0.92 * boot),
    ]
    parts = [part(loft(lower), car.colour_bgr)]
    top_half = half * (1.0 - lines.inset)
    windows = (waist - 0.02, 0.95 * height)
    parts.append(part(_frustum(cabin, roof, half * 0.96, top_half, windows), _GLASS))
    middle = [roof[0], roof[1]]
    parts.append(part(_frustum(middle, middle, top_half, 0.9 * top_half, (0.94 * height, height)), car.colour_bgr))
    if car.kind is CarKind.VAN:
        box = [cabin[1], rear - 0.01 * length]
        parts.append(part(_frustum(box, box, half, 0.96 * half, (waist - 0.05, height)), car.colour_bgr))
    parts.append(part(_frustum([0.9 * front, 0.9 * rear], [front, rear], 0.8 * half, 0.9 * half, (0.12, 0.3)), _UNDER))
    parts += _wheels(length, half)
    parts += _lamps(front, rear, half, (0.7 * bonnet, 0.78 * boot))
    return assembled(parts, span_m=1.0, rest_height_per_span=0.0)


def _section(behind: float, half: float, low: float, high: float) -> FloatArray:
    """Return a rectangle (4, 3) across the car, its upper edges a little drawn in."""
    inner = 0.92 * half
    return np.array([[behind, -half, low], [behind, half, low], [behind, inner, high], [behind, -inner, high]])


def _frustum(
    foot: list[float], top: list[float], foot_half: float, top_half: float, heights: tuple[float, float]
) -> FloatArray:
    """Return a block between two level rectangles: lengthwise from and to, half widths, heights."""
    rings = []
    for (start, end), half, up in ((foot, foot_half, heights[0]), (top, top_half, heights[1])):
        rings.append(np.array([[start, -half, up], [start, half, up], [end, half, up], [end, -half, up]]))
    return loft(rings)


def _wheels(length: float, half: float) -> list[MeshPart]:
    """Return four wheels, flush with the sides."""
    found = []
    for behind in (-0.31 * length, 0.29 * length):
        for side in (-1.0, 1.0):
            middle = np.array([behind, side * (half - 0.6 * _WHEEL_HALF_WIDTH_M), _WHEEL_RADIUS_M])
            found.append(part(wheel(middle, _WHEEL_RADIUS_M, _WHEEL_HALF_WIDTH_M), _TYRE))
    return found


def _lamps(front: float, rear: float, half: float, heights: tuple[float, float]) -> list[MeshPart]:
    """Return head lamps and rear lamps, a little proud of the body."""
    found = []
    for side in (-1.0, 1.0):
        for place, up, colour in ((front, heights[0], _HEADLAMP), (rear, heights[1], _REAR_LAMP)):
            ends = [place - 0.02, place + 0.02]
            block = _frustum(ends, ends, 0.14 * half, 0.14 * half, (up - 0.06, up + 0.06))
            found.append(part(block + np.array([0.0, side * 0.66 * half, 0.0]), colour))
    return found
