"""The fuselage: its section along its length, its skin, canopy, spinner and sensor ball."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.livery import LiverySpec, PaintedArea, painted
from groundstation.simulation.airframes.mesh import MeshPart, loft, part
from groundstation.simulation.airframes.part_specs import HullSpec

_RING = 16
_NOSE = (0.0, 0.06, 0.2, 0.42, 0.7, 1.0)
_AFT = (0.2, 0.4, 0.6, 0.8, 1.0)
# radius of a nose's foremost ring, of the whole
_TIP = 0.12
_SPINNER_OF_PROPELLER, _SPINNER_LENGTH = 0.16, 1.25
# an end is higher than it is wide
_END_HEIGHT = 1.4
_BALL_BGR = (40.0, 38.0, 36.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Hull:
    """A fuselage that begins ``begin`` behind the nose, after a spinner, with a front of ``face`` of its section."""

    spec: HullSpec
    begin: float = 0.0
    face: float = _TIP

    def section(self, behind: float) -> tuple[float, float]:
        """Return half width and half height so far behind the nose, in spans."""
        spec, s = self.spec, self._share(behind)
        wide = high = 1.0
        if s < spec.full_from:
            to_full = 1.0 - s / spec.full_from
            wide = high = self.face + (1.0 - self.face) * (1.0 - to_full**2) ** (0.95 - 0.45 * spec.bluntness)
        elif s > spec.full_to:
            u = (s - spec.full_to) / (1.0 - spec.full_to)
            taper = (1.0 - min(u, 1.0) ** 1.4) ** spec.taper_power
            wide = spec.end_share + (1.0 - spec.end_share) * taper
            end = min(_END_HEIGHT * spec.end_share, 1.0)
            high = end + (1.0 - end) * taper
        return 0.5 * wide * spec.width_per_span, 0.5 * high * spec.height_per_span

    def up(self, behind: float, height: float = 0.0) -> float:
        """Return how far above the nose a height in the section is, −1 its bottom to 1 its top, in spans."""
        spec, s = self.spec, self._share(behind)
        if s < spec.full_from:
            middle = spec.rise * _smooth(s / spec.full_from)
        else:
            aft = _smooth((s - spec.full_to) / (1.0 - spec.full_to))
            middle = spec.rise + (spec.end_rise - spec.rise) * aft
        return middle * spec.height_per_span + height * self.section(behind)[1]

    def ring(self, behind: float) -> FloatArray:
        """Return the section's outline (16, 3)."""
        half_width, half_height = self.section(behind)
        angle = 2.0 * np.pi * np.arange(_RING) / _RING
        power = 2.0 / (2.0 + 2.0 * self.spec.squareness)
        across, high = np.round(np.cos(angle), 12), np.round(np.sin(angle), 12)
        return np.column_stack(
            [
                np.full(_RING, behind),
                half_width * np.sign(across) * np.abs(across) ** power,
                self.up(behind) + half_height * np.sign(high) * np.abs(high) ** power,
            ]
        )

    def at(self, share: float) -> float:
        """Return how far behind the nose a share of the fuselage's own length is, in spans."""
        return self.begin + share * (self.spec.length_per_span - self.begin)

    def _share(self, behind: float) -> float:
        return min(max((behind - self.begin) / (self.spec.length_per_span - self.begin), 0.0), 1.0)


def hull_of(spec: HullSpec, tractor_radius: float | None) -> Hull:
    """Return the fuselage; with a propeller of that radius, in spans, in front, it begins behind the spinner."""
    if tractor_radius is None:
        return Hull(spec=spec)
    radius = spinner_radius(tractor_radius)
    narrow = 0.5 * min(spec.width_per_span, spec.height_per_span)
    face = min(max(0.35 + 0.35 * spec.bluntness, 1.1 * radius / narrow), 1.0)
    return Hull(spec=spec, begin=_SPINNER_LENGTH * radius, face=face)


def spinner_radius(propeller_radius: float) -> float:
    """Return the radius of the spinner of a propeller, in spans."""
    return _SPINNER_OF_PROPELLER * propeller_radius


def spinner(tip: FloatArray, propeller_radius: float, backwards: bool = False) -> FloatArray:
    """Return the spinner with its tip at a point (3,), pointing forward or backwards."""
    radius = spinner_radius(propeller_radius)
    along = _SPINNER_LENGTH * radius * (-1.0 if backwards else 1.0)
    return round_body([tip + np.array([u * along, 0.0, 0.0]) for u in _SPINNER[0]], [radius * r for r in _SPINNER[1]])


# along from the tip, and radius
_SPINNER = ((0.0, 0.12, 0.4, 1.0), (0.12, 0.45, 0.78, 1.0))


def round_body(middles: list[FloatArray], radii: list[float], count: int = 10) -> FloatArray:
    """Return a body of upright round sections with these middles and radii."""
    angle = 2.0 * np.pi * np.arange(count) / count
    circle = np.column_stack([np.zeros(count), np.cos(angle), np.sin(angle)])
    return loft([middle + radius * circle for middle, radius in zip(middles, radii, strict=True)])


def hull_parts(hull: Hull, livery: LiverySpec, canopy_middle: float) -> list[MeshPart]:
    """Return skin, canopy and sensor ball; the canopy is centred at a distance behind the nose, in spans."""
    spec = hull.spec
    shares = {spec.full_from * u for u in _NOSE} | {spec.full_to + (1.0 - spec.full_to) * u for u in _AFT}
    shares.add(spec.full_to)
    places = {hull.at(s) for s in shares}
    boundary = livery.nose_share * spec.length_per_span
    if hull.begin < boundary < spec.length_per_span:
        places.add(boundary)
    skin = loft([hull.ring(behind) for behind in sorted(places)])
    colours = painted(livery, PaintedArea.HULL, skin, spec.length_per_span)
    parts = [MeshPart(triangles=skin, colours_bgr=colours)]
    if spec.canopy_share > 0.0:
        parts.append(part(_canopy(hull, canopy_middle), livery.glass_bgr))
    if spec.sensor_ball:
        parts.append(part(_ball(hull), _BALL_BGR))
    return parts


def _canopy(hull: Hull, middle: float) -> FloatArray:
    """Return a drop half sunk into the fuselage's top."""
    half = 0.5 * hull.spec.canopy_share * hull.spec.length_per_span
    rings = []
    angle = 2.0 * np.pi * np.arange(10) / 10
    for u in (-1.0, -0.85, -0.5, 0.0, 0.45, 0.8, 1.0):
        behind = middle + u * half
        half_width, half_height = hull.section(behind)
        size = max(1.0 - u * u, 0.004) ** 0.5
        across, high = 0.78 * size * half_width * np.cos(angle), 0.62 * size * half_height * np.sin(angle)
        rings.append(np.column_stack([np.full(10, behind), across, hull.up(behind, 0.8) + high]))
    return loft(rings)


def _ball(hull: Hull) -> FloatArray:
    """Return the ball under the nose."""
    radius = 0.3 * min(hull.spec.width_per_span, hull.spec.height_per_span)
    behind = hull.at(0.75 * hull.spec.full_from) + radius
    middle = np.array([behind, 0.0, hull.up(behind, -1.0) - 0.3 * radius])
    turns = np.linspace(0.08, 0.92, 7) * np.pi
    along = [middle + np.array([-radius * np.cos(turn), 0.0, 0.0]) for turn in turns]
    return round_body(along, [float(radius * np.sin(turn)) for turn in turns])


def _smooth(u: float) -> float:
    u = min(max(u, 0.0), 1.0)
    return u * u * (3.0 - 2.0 * u)
