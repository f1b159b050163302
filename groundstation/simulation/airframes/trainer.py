"""A high-winged trainer with a tricycle gear: the aircraft of the standard flights."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.airframe import Airframe
from groundstation.simulation.airframes.mesh import Colour, MeshPart, assembled, loft, part, rod, wheel
from groundstation.simulation.airframes.surfaces import airfoil
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
    """Differences of an aircraft of this kind from the default one.

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
    skin_bgr: Colour = _WHITE
    trim_bgr: Colour = _RED

    def __post_init__(self) -> None:
        for name in ("fuselage_width", "fuselage_height", "length", "chord"):
            require_positive(f"Shape: {name}", getattr(self, name))


def trainer(span_m: float = 2.3, shape: AirframeShape | None = None) -> Airframe:
    """Return the aircraft with this wing span, m, and of this shape; None is the usual one."""
    require_positive("trainer: span_m", span_m)
    shape = AirframeShape() if shape is None else shape
    parts = [*_fuselage(shape), *_surfaces(shape), *_gear(shape)]
    return assembled(parts, span_m=span_m, rest_height_per_span=REST_HEIGHT_PER_SPAN)


def _fuselage(shape: AirframeShape) -> list[MeshPart]:
    angle = 2.0 * np.pi * np.arange(_RING) / _RING
    rings = []
    for usual_behind, usual_half, above, below in _FUSELAGE:
        behind, half = shape.length * usual_behind, shape.fuselage_width * usual_half
        middle, height = 0.5 * (above + below), shape.fuselage_height * 0.5 * (above - below)
        rings.append(np.column_stack([np.full(_RING, behind), half * np.cos(angle), middle + height * np.sin(angle)]))
    cowling, body = loft(rings[:4]), loft(rings[3:])
    return [part(cowling, shape.trim_bgr), part(body, shape.skin_bgr)]


def _surfaces(shape: AirframeShape) -> list[MeshPart]:
    """Return wing (its tips in the trim's colour), tailplane and fin."""
    back, skin, trim = (shape.length - 1.0) * _TAIL, shape.skin_bgr, shape.trim_bgr
    parts: list[MeshPart] = []
    for side in (-1.0, 1.0):
        sections = [_section(shape, side * s, math.sin(_DIHEDRAL_RAD) * s) for s in (0.0, 0.41, 0.5)]
        parts += [part(loft(sections[:2]), skin), part(loft(sections[1:]), trim)]
        plane = [
            _plate(side * s, 0.022, back + _TAIL + sweep, 0.10 - 0.6 * sweep) for s, sweep in ((0.0, 0.0), (0.17, 0.02))
        ]
        parts.append(part(loft(plane), skin))
    fin = []
    for up, lead, chord in ((0.015, 0.66, 0.135), (0.15, 0.725, 0.075)):
        flat = _plate(0.0, 0.0, back + lead, chord)
        fin.append(np.column_stack([flat[:, 0], flat[:, 2], np.full(len(flat), up)]))
    parts.append(part(loft(fin), trim))
    return parts


def _section(shape: AirframeShape, right: float, up: float) -> FloatArray:
    """Return a wing's section, (8, 3)."""
    lead, height = _WING_LEAD + shape.wing_back, _WING_UP + shape.wing_up
    return airfoil(lead, right, height + up, shape.chord * _CHORD, _WING_THICK)


def _plate(right: float, up: float, lead: float, chord: float) -> FloatArray:
    """Return the section of a thin plate, (4, 3)."""
    along, across = np.array([0.0, 0.4, 1.0, 0.4]), np.array([0.0, 0.5, 0.0, -0.5]) * 0.011
    return np.column_stack([lead + chord * along, np.full(4, right), up + across])


def _gear(shape: AirframeShape) -> list[MeshPart]:
    """Return the legs, their wheels and the wing's struts."""
    parts: list[MeshPart] = []
    for side in (-1.0, 1.0):
        foot = np.array([0.31, side * 0.115, _WHEEL_UP])
        parts.append(part(rod(np.array([0.29, side * 0.025, -0.045]), foot, 0.006), _GREY))
        parts.append(part(wheel(foot), _BLACK))
        below, above = np.array([0.28, side * 0.04, -0.03]), np.array([0.28, side * 0.19, 0.094 + shape.wing_up])
        parts.append(part(rod(below, above, 0.004), shape.skin_bgr))
    foot = np.array([0.075, 0.0, _WHEEL_UP])
    parts += [part(rod(np.array([0.065, 0.0, -0.03]), foot, 0.005), _GREY), part(wheel(foot), _BLACK)]
    return parts
