"""Landing gear: wheels or skids on legs down to where all else clears the ground."""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.hull import Hull, round_body
from groundstation.simulation.airframes.kinds import GearKind
from groundstation.simulation.airframes.mesh import Colour, MeshPart, mirrored, part, rod, wheel
from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.airframes.surfaces import wing_root_up

_LEG_BGR: Colour = (80.0, 80.0, 82.0)
_TYRE_BGR: Colour = (26.0, 26.0, 26.0)
_SKID = 0.0045
# of a main wheel
_NOSE_WHEEL, _TAIL_WHEEL = 0.85, 0.5
# a wheel is this much wider than high
_WHEEL_WIDTH = 0.4
# a single wheel is sunk into the belly by this share of its radius
_SUNK = 0.35


def gear_parts(spec: AirframeSpec, hull: Hull, lowest: float) -> tuple[list[MeshPart], float]:
    """Return the gear, and the ground's height above the nose, in spans; ``lowest`` is of all that has to clear it."""
    ground = lowest - spec.gear.clearance_per_span
    match spec.gear.kind:
        case GearKind.TRICYCLE:
            front = _leg_with_wheel(spec, _in_belly(hull, hull.at(0.12)), hull.at(0.12), 0.0, ground, _NOSE_WHEEL)
            return [*_main_wheels(spec, hull, 0.12, ground), *front], ground
        case GearKind.TAIL_WHEEL:
            return [*_main_wheels(spec, hull, -0.2, ground), *_tail_wheel(spec, hull)], ground
        case GearKind.SKIDS:
            return _skids(spec, hull, ground), ground
        case GearKind.SINGLE_WHEEL:
            radius, behind = spec.gear.wheel_per_span, _balance(spec)
            up = min(hull.up(behind, -1.0) + _SUNK * radius, lowest + radius)
            tyre = wheel(np.array([behind, 0.0, up]), radius, _WHEEL_WIDTH * radius)
            return [part(tyre, _TYRE_BGR)], up - radius
        case _:
            return [], lowest


def _balance(spec: AirframeSpec) -> float:
    """Return about where the centre of mass is behind the nose: a quarter into the mean chord."""
    wing = spec.wing
    outward = 0.42
    lift = wing.lead(outward) + 0.25 * wing.chord(outward)
    if spec.foreplane is not None:
        lift -= spec.foreplane.area_share * (lift - spec.foreplane.lead_per_span)
    return min(lift, spec.hull.length_per_span * 0.85)


def _in_belly(hull: Hull, behind: float, right: float = 0.0) -> FloatArray:
    return np.array([behind, right * hull.section(behind)[0], hull.up(behind, -0.6)])


def _main_wheels(spec: AirframeSpec, hull: Hull, chords_behind: float, ground: float) -> list[MeshPart]:
    """Return both main legs with their wheels, so many root chords behind the balance."""
    wing, half = spec.wing, 0.5 * spec.gear.track_per_span
    behind = min(_balance(spec) + chords_behind * wing.root_chord, hull.at(0.9))
    top = _in_belly(hull, behind, 0.6)
    outward = 2.0 * half
    lead, chord = wing.lead(outward), wing.chord(outward)
    under_wing = lead + 0.1 * chord < behind < lead + 0.85 * chord
    if wing.height <= 0.0 and half > 1.3 * hull.section(behind)[0] and under_wing:
        top = np.array([behind, half, wing_root_up(wing, hull) + wing.rise(outward)])
    right = _leg_with_wheel(spec, top, behind, half, ground, 1.0)
    return [*right, *(part(mirrored(p.triangles), _first(p)) for p in right)]


def _first(painted: MeshPart) -> Colour:
    blue, green, red = painted.colours_bgr[0]
    return float(blue), float(green), float(red)


def _leg_with_wheel(
    spec: AirframeSpec, top: FloatArray, behind: float, right: float, ground: float, size: float
) -> list[MeshPart]:
    radius = size * spec.gear.wheel_per_span
    foot = np.array([behind, right, ground + radius])
    tyre = wheel(foot, radius, _WHEEL_WIDTH * radius)
    return [part(rod(top, foot, spec.gear.leg_per_span), _LEG_BGR), part(tyre, _TYRE_BGR)]


def _tail_wheel(spec: AirframeSpec, hull: Hull) -> list[MeshPart]:
    radius = _TAIL_WHEEL * spec.gear.wheel_per_span
    behind = hull.at(0.94)
    foot = np.array([behind + 0.01, 0.0, hull.up(behind, -1.0) - 1.3 * radius])
    top = np.array([behind, 0.0, hull.up(behind, -0.5)])
    return [
        part(rod(top, foot, 0.6 * spec.gear.leg_per_span), _LEG_BGR),
        part(wheel(foot, radius, _WHEEL_WIDTH * radius), _TYRE_BGR),
    ]


def _skids(spec: AirframeSpec, hull: Hull, ground: float) -> list[MeshPart]:
    """Return two runners, bent up in front, each on two legs."""
    half, middle = 0.5 * spec.gear.track_per_span, _balance(spec)
    reach = min(0.16, 0.35 * spec.hull.length_per_span)
    begin, end = max(middle - reach, hull.at(0.05) + 0.02), middle + 0.8 * reach
    places = [(begin - 0.02, 0.02), (begin, 0.0), (end, 0.0), (end + 0.01, 0.004)]
    middles = [np.array([behind, half, ground + _SKID + up]) for behind, up in places]
    bodies = [round_body(middles, [_SKID] * 4, count=6)]
    for behind in (begin + 0.03, min(end - 0.03, hull.at(0.93))):
        top = _in_belly(hull, behind, 0.6)
        bodies.append(rod(top, np.array([behind, half, ground + _SKID]), 0.8 * spec.gear.leg_per_span))
    return [part(b, _LEG_BGR) for body in bodies for b in (body, mirrored(body))]
