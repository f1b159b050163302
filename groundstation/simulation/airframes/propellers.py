"""Propellers as an exposure smears them: thin transparent discs, or sectors of them, with spinners and nacelles."""

import math

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.equipment_specs import PropellerSpec
from groundstation.simulation.airframes.hull import Hull, round_body, spinner, spinner_radius
from groundstation.simulation.airframes.kinds import PropellerKind
from groundstation.simulation.airframes.livery import PaintedArea
from groundstation.simulation.airframes.mesh import MeshPart, loft, mirrored, part
from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.airframes.surfaces import both_sides, wing_root_up

_HALF_THICKNESS = 0.0008
_FULL_TURN_STEPS = 24
_DENSEST = 0.95
_SPINNER_BGR = (90.0, 90.0, 92.0)
_NACELLE_RADIUS, _MOST_PROTRUSION = 0.024, 0.08
# of the spinner's length, from its tip
_DISC_IN_SPINNER = 0.6


def propeller_parts(spec: AirframeSpec, hull: Hull) -> list[MeshPart]:
    """Return spinners, nacelles, and the smeared blades."""
    propeller = spec.propeller
    match propeller.kind:
        case PropellerKind.TRACTOR:
            tip, backwards = np.zeros(3), False
        case PropellerKind.PUSHER:
            end = pusher_hub(spec)
            length = 1.25 * spinner_radius(propeller.radius_per_span)
            tip, backwards = np.array([end + length, 0.0, hull.up(end)]), True
        case PropellerKind.PAIR:
            return _pair(spec, hull)
        case _:
            return []
    colour = spec.livery.second_bgr if spec.livery.nose_share > 0.0 and not backwards else _SPINNER_BGR
    return [part(spinner(tip, propeller.radius_per_span, backwards), colour), *_disc(propeller, tip, backwards)]


def pusher_hub(spec: AirframeSpec) -> float:
    """Return how far behind the nose the hub of a pusher propeller begins, in spans."""
    return spec.hull.length_per_span


def _pair(spec: AirframeSpec, hull: Hull) -> list[MeshPart]:
    """Return a nacelle with its propeller in front of each half of the wing."""
    wing, propeller = spec.wing, spec.propeller
    right = propeller.radius_per_span + 0.5 * spec.hull.width_per_span + 0.015
    outward = min(2.0 * right, 0.8)
    lead, chord = wing.lead(outward), wing.chord(outward)
    tip_at = lead - min(_MOST_PROTRUSION, max(lead - 0.01, 0.0))
    tip = np.array([tip_at, 0.5 * outward, wing_root_up(wing, hull) + wing.rise(outward)])
    hub = 1.25 * spinner_radius(propeller.radius_per_span)
    end = lead + 0.75 * chord
    places = [tip_at + hub, 0.5 * (tip_at + hub + lead), lead + 0.2 * chord, lead + 0.5 * chord, end]
    middles = [np.array([behind, tip[1], tip[2]]) for behind in places]
    body = round_body(middles, [_NACELLE_RADIUS * s for s in (0.75, 1.0, 1.0, 0.8, 0.2)])
    parts = both_sides(body, spec.livery, PaintedArea.BOOM)
    cone = spinner(tip, propeller.radius_per_span)
    parts += [part(cone, _SPINNER_BGR), part(mirrored(cone), _SPINNER_BGR)]
    discs = _disc(propeller, tip, False)
    return [*parts, *discs, *(_other_side(disc) for disc in discs)]


def _other_side(disc: MeshPart) -> MeshPart:
    return MeshPart(triangles=mirrored(disc.triangles), colours_bgr=disc.colours_bgr, opacity=disc.opacity)


def _disc(propeller: PropellerSpec, tip: FloatArray, backwards: bool) -> list[MeshPart]:
    """Return what the blades smear, behind (or before) a spinner's tip (3,)."""
    length = 1.25 * spinner_radius(propeller.radius_per_span) * (-1.0 if backwards else 1.0)
    middle = tip + np.array([_DISC_IN_SPINNER * length, 0.0, 0.0])
    opacity = min(propeller.opacity / propeller.smear_share, _DENSEST)
    pitch = 2.0 * math.pi / propeller.blades
    sectors: list[FloatArray] = []
    if propeller.smear_share == 1.0:
        sectors.append(_circle(propeller.radius_per_span, 0.0, 2.0 * math.pi, False))
    else:
        for blade in range(propeller.blades):
            begin = propeller.phase_rad + blade * pitch
            end = begin + propeller.smear_share * pitch
            sectors.append(_circle(propeller.radius_per_span, begin, end, True))
    parts = []
    thick = np.array([_HALF_THICKNESS, 0.0, 0.0])
    for outline in sectors:
        body = loft([middle - thick + outline, middle + thick + outline])
        colours = np.tile(propeller.colour_bgr, (len(body), 1))
        parts.append(MeshPart(triangles=body, colours_bgr=colours, opacity=opacity))
    return parts


def _circle(radius: float, begin: float, end: float, with_hub: bool) -> FloatArray:
    """Return the outline (n, 3) of a disc, or of a sector with the hub as its corner."""
    steps = max(math.ceil(_FULL_TURN_STEPS * (end - begin) / (2.0 * math.pi)), 2)
    angle = begin + (end - begin) * np.arange(steps + int(with_hub)) / steps
    rim = np.column_stack([np.zeros(len(angle)), radius * np.cos(angle), radius * np.sin(angle)])
    return np.vstack([np.zeros((1, 3)), rim]) if with_hub else rim
