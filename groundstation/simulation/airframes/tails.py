"""Tailplanes, fins, V tails, and the booms that carry them."""

import math

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.hull import Hull, round_body
from groundstation.simulation.airframes.kinds import AirframeFamily, TailKind
from groundstation.simulation.airframes.livery import PaintedArea, painted
from groundstation.simulation.airframes.mesh import MeshPart
from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.airframes.surfaces import Planform, both_sides, flat, planform, wing_root_up

_RIGHT, _UP = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
_BOOM_RADIUS = 0.011
# twin fins of these stand on the wing
_ON_WING = (AirframeFamily.FLYING_WING, AirframeFamily.DELTA, AirframeFamily.CANARD)


def tail_parts(spec: AirframeSpec, hull: Hull) -> list[MeshPart]:
    """Return the tail and what carries it."""
    kind = spec.tail.kind
    if spec.has_booms:
        return [*_booms(spec, hull), *_between_booms(spec, hull)]
    if kind is TailKind.NONE:
        return []
    if kind in (TailKind.V, TailKind.INVERTED_V):
        return _v_tail(spec, hull)
    if kind is TailKind.TWIN_FIN:
        return _fins_on_wing(spec, hull) if spec.family in _ON_WING else _twin_fin_tail(spec, hull)
    fin, tip = _centre_fin(spec, hull)
    if kind is TailKind.FIN:
        return [fin]
    form = _plane_form(spec)
    end = spec.tail.end_per_span
    root = np.array([end - form.root_chord, 0.0, hull.up(end - 0.5 * form.root_chord, 0.3)])
    if kind is TailKind.T:
        # its middle over the middle of the fin's tip
        root = tip + np.array([-0.5 * form.root_chord, 0.0, 0.0])
    return [fin, *both_sides(flat(root, _RIGHT, form), spec.livery, PaintedArea.TAIL)]


def wing_area(spec: AirframeSpec) -> float:
    """Return the wing's area in square spans."""
    return 1.0 / spec.wing.aspect_ratio


def _plane_form(spec: AirframeSpec) -> Planform:
    tail = spec.tail
    return planform(tail.area_share * wing_area(spec), tail.aspect_ratio, tail.taper, tail.sweep_rad)


def _fin_form(spec: AirframeSpec, count: int) -> Planform:
    tail = spec.tail
    area = tail.fin_area_share * wing_area(spec) / count
    return planform(area, tail.fin_aspect_ratio, tail.fin_taper, tail.fin_sweep_rad, halves=1)


def _centre_fin(spec: AirframeSpec, hull: Hull) -> tuple[MeshPart, FloatArray]:
    """Return the fin and the middle (3,) of its tip's chord."""
    form, end = _fin_form(spec, 1), spec.tail.end_per_span
    behind = end - 0.5 * form.root_chord
    # its area is the part above the fuselage
    sunk = hull.section(behind)[1]
    form = Planform(
        reach=form.reach + sunk, root_chord=form.root_chord, tip_chord=form.tip_chord, swept=form.swept + 0.3 * sunk
    )
    root = np.array([end - form.root_chord, 0.0, hull.up(behind)])
    fin = flat(root, _UP, form)
    tip = root + np.array([form.swept + 0.5 * form.tip_chord, 0.0, 0.985 * form.reach])
    return MeshPart(triangles=fin, colours_bgr=painted(spec.livery, PaintedArea.FIN, fin)), tip


def _v_tail(spec: AirframeSpec, hull: Hull) -> list[MeshPart]:
    form, end = _plane_form(spec), spec.tail.end_per_span
    angle = spec.tail.v_angle_rad * (-1.0 if spec.tail.kind is TailKind.INVERTED_V else 1.0)
    outward = np.array([0.0, math.cos(angle), math.sin(angle)])
    root = np.array([end - form.root_chord, 0.0, hull.up(end - 0.5 * form.root_chord)])
    return both_sides(flat(root, outward, form), spec.livery, PaintedArea.TAIL)


def _twin_fin_tail(spec: AirframeSpec, hull: Hull) -> list[MeshPart]:
    """Return a tailplane with a fin at each tip, a third of it below the plane."""
    form, fin, end = _plane_form(spec), _fin_form(spec, 2), spec.tail.end_per_span
    up = hull.up(end - 0.5 * form.root_chord, 0.3)
    plane = flat(np.array([end - form.root_chord, 0.0, up]), _RIGHT, form)
    tip_lead = end - form.root_chord + form.swept
    root = np.array([tip_lead + form.tip_chord - fin.root_chord, 0.985 * form.reach, up - 0.3 * fin.reach])
    fins = both_sides(flat(root, _UP, fin), spec.livery, PaintedArea.FIN)
    return [*both_sides(plane, spec.livery, PaintedArea.TAIL), *fins]


def _fins_on_wing(spec: AirframeSpec, hull: Hull) -> list[MeshPart]:
    wing, form = spec.wing, _fin_form(spec, 2)
    outward = spec.tail.fin_spacing_per_span
    chord = wing.chord(outward)
    shrunk = min(0.85 * chord / form.root_chord, 1.0)
    form = Planform(
        reach=form.reach, root_chord=shrunk * form.root_chord, tip_chord=shrunk * form.tip_chord, swept=form.swept
    )
    lead = wing.lead(outward) + 0.97 * chord - form.root_chord
    root = np.array([lead, 0.5 * outward, wing_root_up(wing, hull) + wing.rise(outward)])
    return both_sides(flat(root, _UP, form), spec.livery, PaintedArea.FIN)


def boom_place(spec: AirframeSpec, hull: Hull) -> FloatArray:
    """Return where the right boom begins, (3,)."""
    wing, outward = spec.wing, spec.tail.fin_spacing_per_span
    lead = max(wing.lead(outward) - 0.015, 0.01)
    up = wing_root_up(wing, hull) + wing.rise(outward) + 0.1 * wing.thickness * wing.chord(outward)
    return np.array([lead, 0.5 * outward, up])


def _booms(spec: AirframeSpec, hull: Hull) -> list[MeshPart]:
    begin, end = boom_place(spec, hull), spec.tail.end_per_span
    places = [begin[0], begin[0] + 0.012, begin[0] + 0.1, end - 0.01, end]
    middles = [np.array([behind, begin[1], begin[2]]) for behind in places]
    shares = (0.35, 0.9, 1.0, 0.75, 0.4)
    return both_sides(round_body(middles, [_BOOM_RADIUS * s for s in shares]), spec.livery, PaintedArea.BOOM)


def _between_booms(spec: AirframeSpec, hull: Hull) -> list[MeshPart]:
    tail = spec.tail
    _, right, up = boom_place(spec, hull)
    area = tail.area_share * wing_area(spec)
    # between the booms, or along the two halves of the inverted V
    inverted = tail.kind is TailKind.INVERTED_V
    half = right / math.cos(tail.v_angle_rad) if inverted else right
    chord = min(0.5 * area / half, 0.25)
    lead = tail.end_per_span - chord
    if inverted:
        outward = np.array([0.0, -math.cos(tail.v_angle_rad), math.sin(tail.v_angle_rad)])
        # the tip's rounding is within the other half
        form = Planform(reach=1.02 * half, root_chord=chord, tip_chord=chord, swept=0.0)
        return both_sides(flat(np.array([lead, right, up]), outward, form), spec.livery, PaintedArea.TAIL)
    fin = _fin_form(spec, 2)
    form = Planform(reach=right, root_chord=chord, tip_chord=chord, swept=0.0)
    plane = both_sides(flat(np.array([lead, 0.0, up]), _RIGHT, form), spec.livery, PaintedArea.TAIL)
    root = np.array([tail.end_per_span - fin.root_chord, right, up - 0.15 * fin.reach])
    return [*plane, *both_sides(flat(root, _UP, fin), spec.livery, PaintedArea.FIN)]
