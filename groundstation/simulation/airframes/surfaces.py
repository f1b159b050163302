"""Lifting surfaces: the wing with its winglets and struts, the foreplane, and flat surfaces of any direction."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.hull import Hull
from groundstation.simulation.airframes.livery import LiverySpec, PaintedArea, band_edges, painted
from groundstation.simulation.airframes.mesh import MeshPart, loft, mirrored, rod
from groundstation.simulation.airframes.part_specs import ForeplaneSpec, WingSpec

# of a tail's or fin's chord
_THIN = 0.09
# the rounded tip of a wing: from where it is rounded, and its last chord
_ROUNDED_FROM, _TIP_CHORD = 0.975, 0.72


@dataclass(frozen=True, slots=True, kw_only=True)
class Planform:
    """One half of a straight tapered surface, in spans: its reach, its chords, and how far its tip is swept."""

    reach: float
    root_chord: float
    tip_chord: float
    swept: float


def planform(area: float, aspect_ratio: float, taper: float, sweep_rad: float, halves: int = 2) -> Planform:
    """Return the planform of a surface with this area, in square spans, of one half (a fin) or two (a tailplane)."""
    reach = float(np.sqrt(area * aspect_ratio)) / halves
    root = 2.0 * area / (halves * reach * (1.0 + taper))
    return Planform(reach=reach, root_chord=root, tip_chord=taper * root, swept=reach * float(np.tan(sweep_rad)))


def airfoil(lead: float, right: float, up: float, chord: float, thickness: float) -> FloatArray:
    """Return a wing's section, (8, 3); its thickness is in chords."""
    along = np.array([0.0, 0.08, 0.3, 0.65, 1.0, 0.65, 0.3, 0.08])
    across = np.array([0.0, 0.45, 0.62, 0.4, 0.0, -0.25, -0.38, -0.3]) * thickness
    return np.column_stack([lead + chord * along, np.full(8, right), up + chord * across])


def flat(root: FloatArray, outward: FloatArray, form: Planform) -> FloatArray:
    """Return a symmetric surface from its root's leading edge (3,) in a direction (3,) without a part along x."""
    along = np.array([0.0, 0.1, 0.4, 1.0, 0.4, 0.1])
    across = np.array([0.0, 0.4, 0.5, 0.0, -0.5, -0.4]) * _THIN
    normal = np.cross([1.0, 0.0, 0.0], outward)
    rings = []
    # the last two round the tip
    for share, chord in (
        (0.0, form.root_chord),
        (0.94, 0.06 * form.root_chord + 0.94 * form.tip_chord),
        (1.0, 0.75 * form.tip_chord),
    ):
        lead = root + share * (form.reach * outward + np.array([form.swept, 0.0, 0.0]))
        lead = lead + np.array([0.15 * form.tip_chord * (share == 1.0), 0.0, 0.0])
        rings.append(lead + np.outer(chord * along, [1.0, 0.0, 0.0]) + np.outer(chord * across, normal))
    return loft(rings)


def both_sides(triangles: FloatArray, livery: LiverySpec, area: PaintedArea) -> list[MeshPart]:
    """Return a painted part and its mirror image."""
    colours = painted(livery, area, triangles)
    return [
        MeshPart(triangles=triangles, colours_bgr=colours),
        MeshPart(triangles=mirrored(triangles), colours_bgr=colours),
    ]


def wing_root_up(wing: WingSpec, hull: Hull) -> float:
    """Return how far the wing's root is above the nose, in spans."""
    end = hull.spec.length_per_span
    places = [min(wing.lead_per_span + u * wing.root_chord, end) for u in (0.1, 0.4, 0.7)]
    ups = [hull.up(behind, wing.height) for behind in places]
    # where the fuselage tapers, the wing stays within it
    return min(ups) if wing.height > 0.0 else max(ups)


def wing_parts(wing: WingSpec, hull: Hull, livery: LiverySpec) -> list[MeshPart]:
    """Return both halves, winglets and struts."""
    root_up = wing_root_up(wing, hull)
    outwards = {0.0, _ROUNDED_FROM, *band_edges(livery)}
    if 0.0 < wing.straight_share < _ROUNDED_FROM:
        outwards.add(wing.straight_share)
    rings = []
    for outward in sorted(o for o in outwards if o <= _ROUNDED_FROM):
        rings.append(_wing_section(wing, outward, root_up, 1.0))
    rings.append(_wing_section(wing, 1.0, root_up, _TIP_CHORD))
    parts = both_sides(loft(rings), livery, PaintedArea.WING)
    if wing.winglet_per_span > 0.0:
        parts += both_sides(_winglet(wing, root_up), livery, PaintedArea.FIN)
    if wing.struts:
        behind = wing.lead(0.4) + 0.35 * wing.chord(0.4)
        half_width = hull.section(behind)[0]
        below = np.array([behind, 0.85 * half_width, hull.up(behind, -0.7)])
        above = np.array([behind, 0.5 * 0.45, root_up + wing.rise(0.45)])
        parts += both_sides(rod(below, above, 0.004), livery, PaintedArea.BOOM)
    return parts


def _wing_section(wing: WingSpec, outward: float, root_up: float, share: float) -> FloatArray:
    chord = wing.chord(outward)
    lead = wing.lead(outward) + 0.5 * (1.0 - share) * chord
    return airfoil(lead, 0.5 * outward, root_up + wing.rise(outward), share * chord, wing.thickness)


def _winglet(wing: WingSpec, root_up: float) -> FloatArray:
    cant, chord = wing.winglet_cant_rad, wing.chord(1.0)
    outward = np.array([0.0, np.sin(cant), np.cos(cant)])
    root = np.array([wing.lead(1.0) + 0.18 * chord, 0.5 - 0.02 * chord, root_up + wing.rise(1.0) - 0.01 * chord])
    height = wing.winglet_per_span
    form = Planform(reach=height, root_chord=0.78 * chord, tip_chord=0.45 * chord, swept=0.7 * height)
    return flat(root, outward, form)


def foreplane_parts(foreplane: ForeplaneSpec, wing_area: float, hull: Hull, livery: LiverySpec) -> list[MeshPart]:
    """Return both halves of the foreplane; the wing's area is in square spans."""
    form = planform(foreplane.area_share * wing_area, foreplane.aspect_ratio, foreplane.taper, foreplane.sweep_rad)
    lead = foreplane.lead_per_span
    root = np.array([lead, 0.0, hull.up(lead + 0.5 * form.root_chord, foreplane.height)])
    return both_sides(flat(root, np.array([0.0, 1.0, 0.0]), form), livery, PaintedArea.TAIL)
