"""An airframe from its parameters: all parts in spans, scaled so that the span is exact."""

import math
from dataclasses import replace

import numpy as np

from groundstation.simulation.airframes.airframe import AircraftLight, Airframe
from groundstation.simulation.airframes.gear import gear_parts
from groundstation.simulation.airframes.hull import Hull, hull_of, hull_parts
from groundstation.simulation.airframes.kinds import AirframeFamily, GearKind, PropellerKind
from groundstation.simulation.airframes.mesh import MeshPart, assembled
from groundstation.simulation.airframes.propellers import propeller_parts
from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.airframes.surfaces import foreplane_parts, wing_parts, wing_root_up
from groundstation.simulation.airframes.tails import tail_parts, wing_area

_RED, _GREEN, _WHITE = (60.0, 60.0, 255.0), (120.0, 255.0, 60.0), (255.0, 255.0, 255.0)
_FORWARD, _BACKWARD = (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)
# sectors of navigation lights: 110° to each side from ahead, 140° behind; the halves of them from their middles
_SIDE_RAD, _TAIL_RAD, _LANDING_RAD = math.radians(55.0), math.radians(70.0), math.radians(12.0)
_ON_LEGS = (GearKind.TRICYCLE, GearKind.TAIL_WHEEL, GearKind.SKIDS)


def build_airframe(spec: AirframeSpec) -> Airframe:
    """Return the airframe of these parameters."""
    hull = _hull(spec)
    parts, ground = parts_of(spec)
    widest = max(float(np.abs(p.triangles[:, :, 1]).max()) for p in parts)
    # a wing tip is at half the span, but winglets may lean farther out
    unit_m = 0.5 * spec.span_m / widest
    built = assembled(parts, span_m=unit_m, rest_height_per_span=-ground, lights=_lights(spec, hull, unit_m))
    return replace(built, span_m=spec.span_m)


def parts_of(spec: AirframeSpec) -> tuple[list[MeshPart], float]:
    """Return all closed parts in spans, behind the nose, right and up, and where the ground is, above the nose."""
    hull = _hull(spec)
    parts = [
        *hull_parts(hull, spec.livery, _canopy_middle(spec, hull)),
        *wing_parts(spec.wing, hull, spec.livery),
        *tail_parts(spec, hull),
    ]
    if spec.foreplane is not None:
        parts += foreplane_parts(spec.foreplane, wing_area(spec), hull, spec.livery)
    blades = propeller_parts(spec, hull)
    # what lands on its belly has stopped its propeller
    clearing = [*parts, *blades] if spec.gear.kind in _ON_LEGS else parts
    lowest = min(float(p.triangles[:, :, 2].min()) for p in clearing)
    gear, ground = gear_parts(spec, hull, lowest)
    return [*parts, *blades, *gear], ground


def _hull(spec: AirframeSpec) -> Hull:
    tractor = spec.propeller.kind is PropellerKind.TRACTOR
    return hull_of(spec.hull, spec.propeller.radius_per_span if tractor else None)


def _canopy_middle(spec: AirframeSpec, hull: Hull) -> float:
    """Return where the canopy is: over a low wing, before a high one, else in front."""
    half = 0.5 * spec.hull.canopy_share * spec.hull.length_per_span
    wing = spec.wing
    if wing.height < 0.0 and spec.family not in (AirframeFamily.DELTA, AirframeFamily.CANARD):
        middle = wing.lead_per_span + 0.35 * wing.root_chord
    else:
        middle = min(wing.lead_per_span + 0.1 * wing.root_chord - half, hull.at(0.4))
    return max(middle, hull.at(0.04) + half)


def _lights(spec: AirframeSpec, hull: Hull, unit_m: float) -> tuple[AircraftLight, ...]:
    """Return the lights; ``unit_m`` is what a span of the parts is."""
    wing, lights = spec.wing, spec.lights
    behind, up = wing.lead(1.0) + 0.2 * wing.chord(1.0), wing_root_up(wing, hull) + wing.rise(1.0)
    left, right = ((-unit_m * behind, side * 0.5 * unit_m, -unit_m * up) for side in (-1.0, 1.0))
    end = max(spec.hull.length_per_span, spec.tail.end_per_span)
    tail = (-unit_m * end, 0.0, -unit_m * hull.up(end, 1.0))
    found: list[AircraftLight] = []
    if lights.navigation_cd > 0.0:
        c, s = math.cos(_SIDE_RAD), math.sin(_SIDE_RAD)
        for place, colour, axis, half in (
            (left, _RED, (c, -s, 0.0), _SIDE_RAD),
            (right, _GREEN, (c, s, 0.0), _SIDE_RAD),
            (tail, _WHITE, _BACKWARD, _TAIL_RAD),
        ):
            found.append(
                AircraftLight(
                    position_body_m=place,
                    colour_bgr=colour,
                    intensity=lights.navigation_cd,
                    axis_body=axis,
                    half_angle_rad=half,
                )
            )
    if lights.strobe_cd > 0.0:
        for place in (left, right):
            found.append(
                AircraftLight(
                    position_body_m=place,
                    colour_bgr=_WHITE,
                    intensity=lights.strobe_cd,
                    period_s=lights.strobe_period_s,
                    lit_share=lights.strobe_lit_share,
                )
            )
    if lights.landing_cd > 0.0:
        place = (-unit_m * hull.at(0.02), 0.0, -unit_m * hull.up(hull.at(0.02), -0.8))
        found.append(
            AircraftLight(
                position_body_m=place,
                colour_bgr=_WHITE,
                intensity=lights.landing_cd,
                axis_body=_FORWARD,
                half_angle_rad=_LANDING_RAD,
            )
        )
    return tuple(found)
