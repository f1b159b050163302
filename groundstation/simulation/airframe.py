"""The shape of the aircraft: a high-winged trainer with a tricycle gear, as closed triangles with colours.

Body frame: x forward, y right, z down, in m; its origin is the target point, the centre of the nose.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import require_positive

# everything below is in wing spans
_RING = 12
# behind the nose, half width, upper and lower edge (up is positive)
_FUSELAGE = (
    (-0.006, 0.010, 0.010, -0.010),
    (0.010, 0.022, 0.022, -0.022),
    (0.05, 0.033, 0.034, -0.034),
    (0.13, 0.042, 0.048, -0.044),
    (0.20, 0.045, 0.082, -0.050),
    (0.30, 0.045, 0.088, -0.052),
    (0.40, 0.040, 0.074, -0.048),
    (0.55, 0.026, 0.042, -0.030),
    (0.78, 0.010, 0.028, 0.004),
)
_CHORD = 0.165
_WING_LEAD = 0.215
_WING_UP = 0.088
_WING_THICK = 0.12  # of the chord
_DIHEDRAL_RAD = math.radians(2.0)
_TAIL = 0.70
_WHEEL_UP = -0.152
_WHITE, _RED, _GREY, _BLACK = (205.0, 208.0, 210.0), (44.0, 36.0, 150.0), (80.0, 80.0, 82.0), (26.0, 26.0, 26.0)

# what a nose is above the runway while all wheels stand on it, in spans
REST_HEIGHT_PER_SPAN = -_WHEEL_UP + 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class AirframeShape:
    """How an aircraft of this kind differs from the usual one.

    Attributes
    ----------
    fuselage_width, fuselage_height, length, chord : as multiples of the usual ones.
    wing_back, wing_up : how much farther back and higher the wing is, in spans.
    skin_bgr, trim_bgr : of the most of it; of cowling, wing tips and fin.
    """

    fuselage_width: float = 1.0
    fuselage_height: float = 1.0
    length: float = 1.0
    chord: float = 1.0
    wing_back: float = 0.0
    wing_up: float = 0.0
    skin_bgr: tuple[float, float, float] = _WHITE
    trim_bgr: tuple[float, float, float] = _RED

    def __post_init__(self) -> None:
        for name in ("fuselage_width", "fuselage_height", "length", "chord"):
            require_positive(f"Shape: {name}", getattr(self, name))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Airframe:
    """An aircraft's skin: ``corners_body_m`` (n, 3, 3) of n triangles, ``normals_body`` (n, 3) outward, and
    ``colours_bgr`` (n, 3), 0 to 255, as a camera sees them in full light.
    """

    corners_body_m: FloatArray
    normals_body: FloatArray
    colours_bgr: FloatArray
    span_m: float


def trainer(span_m: float = 2.3, shape: AirframeShape | None = None) -> Airframe:
    """Return the aircraft with this wing span, m, and of this shape; None is the usual one."""
    require_positive("trainer: span_m", span_m)
    shape = AirframeShape() if shape is None else shape
    parts = [*_fuselage(shape), *_surfaces(shape), *_gear(shape)]
    corners = np.concatenate([_outward(triangles) for triangles, _ in parts])
    colours = np.concatenate([np.tile(colour, (len(triangles), 1)) for triangles, colour in parts])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    kept = area > 1e-12
    # parts are given as behind the nose, right, up
    to_body = np.array([-span_m, span_m, -span_m])
    return Airframe(
        corners_body_m=corners[kept] * to_body,
        normals_body=normals[kept] / area[kept, None] * np.sign(to_body),
        colours_bgr=colours[kept],
        span_m=span_m,
    )


_Part = tuple[FloatArray, tuple[float, float, float]]


def _fuselage(shape: AirframeShape) -> list[_Part]:
    angle = 2.0 * np.pi * np.arange(_RING) / _RING
    rings = []
    for usual_behind, usual_half, above, below in _FUSELAGE:
        behind, half = shape.length * usual_behind, shape.fuselage_width * usual_half
        middle, height = 0.5 * (above + below), shape.fuselage_height * 0.5 * (above - below)
        rings.append(np.column_stack([np.full(_RING, behind), half * np.cos(angle), middle + height * np.sin(angle)]))
    cowling, body = _loft(rings[:4]), _loft(rings[3:])
    return [(cowling, shape.trim_bgr), (body, shape.skin_bgr)]


def _surfaces(shape: AirframeShape) -> list[_Part]:
    """Return wing (its tips in the trim's colour), tailplane and fin."""
    back, skin, trim = (shape.length - 1.0) * _TAIL, shape.skin_bgr, shape.trim_bgr
    parts: list[_Part] = []
    for side in (-1.0, 1.0):
        sections = [_section(shape, side * s, math.sin(_DIHEDRAL_RAD) * s) for s in (0.0, 0.41, 0.5)]
        parts += [(_loft(sections[:2]), skin), (_loft(sections[1:]), trim)]
        plane = [
            _plate(side * s, 0.022, back + _TAIL + sweep, 0.10 - 0.6 * sweep) for s, sweep in ((0.0, 0.0), (0.17, 0.02))
        ]
        parts.append((_loft(plane), skin))
    fin = []
    for up, lead, chord in ((0.015, 0.66, 0.135), (0.15, 0.725, 0.075)):
        flat = _plate(0.0, 0.0, back + lead, chord)
        fin.append(np.column_stack([flat[:, 0], flat[:, 2], np.full(len(flat), up)]))
    parts.append((_loft(fin), trim))
    return parts


def _section(shape: AirframeShape, right: float, up: float) -> FloatArray:
    """Return a wing's section, (8, 3)."""
    chord = shape.chord * _CHORD
    along = np.array([0.0, 0.08, 0.3, 0.65, 1.0, 0.65, 0.3, 0.08])
    across = np.array([0.0, 0.45, 0.62, 0.4, 0.0, -0.25, -0.38, -0.3]) * _WING_THICK
    lead, height = _WING_LEAD + shape.wing_back, _WING_UP + shape.wing_up
    place = [lead + chord * along, np.full(8, right), height + up + chord * across]
    return np.column_stack(place)


def _plate(right: float, up: float, lead: float, chord: float) -> FloatArray:
    """Return the section of a thin plate, (4, 3)."""
    along, across = np.array([0.0, 0.4, 1.0, 0.4]), np.array([0.0, 0.5, 0.0, -0.5]) * 0.011
    return np.column_stack([lead + chord * along, np.full(4, right), up + across])


def _gear(shape: AirframeShape) -> list[_Part]:
    """Return the legs, their wheels and the wing's struts."""
    parts: list[_Part] = []
    for side in (-1.0, 1.0):
        foot = np.array([0.31, side * 0.115, _WHEEL_UP])
        parts.append((_rod(np.array([0.29, side * 0.025, -0.045]), foot, 0.006), _GREY))
        parts.append((_wheel(foot), _BLACK))
        parts.append(
            (
                _rod(np.array([0.28, side * 0.04, -0.03]), np.array([0.28, side * 0.19, 0.094 + shape.wing_up]), 0.004),
                shape.skin_bgr,
            )
        )
    foot = np.array([0.075, 0.0, _WHEEL_UP])
    parts += [(_rod(np.array([0.065, 0.0, -0.03]), foot, 0.005), _GREY), (_wheel(foot), _BLACK)]
    return parts


def _rod(start: FloatArray, end: FloatArray, radius: float) -> FloatArray:
    along = (end - start) / np.linalg.norm(end - start)
    aside = np.cross(along, [1.0, 0.0, 0.0])
    aside /= np.linalg.norm(aside)
    other = np.cross(along, aside)
    angle = 2.0 * np.pi * np.arange(6) / 6
    ring = radius * (np.outer(np.cos(angle), aside) + np.outer(np.sin(angle), other))
    return _loft([start + ring, end + ring])


def _wheel(middle: FloatArray, radius: float = 0.02, half_width: float = 0.008) -> FloatArray:
    angle = 2.0 * np.pi * np.arange(12) / 12
    ring = np.column_stack([radius * np.cos(angle), np.zeros(12), radius * np.sin(angle)])
    width = np.array([0.0, half_width, 0.0])
    return _loft([middle - width + ring, middle + width + ring])


def _loft(rings: list[FloatArray]) -> FloatArray:
    """Return the triangles (n, 3, 3) of a closed body through rings of equally many points."""
    triangles = []
    count = len(rings[0])
    for near, far in itertools.pairwise(rings):
        for k in range(count):
            after = (k + 1) % count
            triangles += [(near[k], far[k], far[after]), (near[k], far[after], near[after])]
    for ring in (rings[0], rings[-1]):
        middle = ring.mean(axis=0)
        triangles += [(middle, ring[k], ring[(k + 1) % count]) for k in range(count)]
    return np.array(triangles)


def _outward(triangles: FloatArray) -> FloatArray:
    """Return a convex part's triangles with their corners in the order that makes the normals point outward."""
    faces = triangles.mean(axis=1) - triangles.reshape(-1, 3).mean(axis=0)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = np.einsum("ij,ij->i", faces, normals) < 0
    turned = triangles.copy()
    turned[inward, 1], turned[inward, 2] = triangles[inward, 2], triangles[inward, 1]
    return turned
