"""The shape of a bird: body, tail, and wings of two joints that beat, as triangles in the body frame.

Body frame: x forward, y right, z down, in m; its origin is the middle of the body.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.mesh import doubled_areas, loft
from groundstation.simulation.traffic.bird_spec import BirdSpec

_RING_POINTS = 8
# along the body from the beak's tip, its half width and the height of its middle, in body lengths without the tail:
# beak, face, head, neck, breast, back, rump, coverts of the tail
_RINGS = (
    (0.00, 0.008, 0.020),
    (0.09, 0.040, 0.025),
    (0.17, 0.085, 0.030),
    (0.27, 0.080, 0.015),
    (0.48, 0.135, 0.000),
    (0.74, 0.095, 0.008),
    (0.98, 0.040, 0.020),
    (1.22, 0.010, 0.020),
)
_TAIL_SHARE, _TAIL_HALF_WIDTH = 0.24, 0.11
# the wing's planform: share of the half span, and leading and trailing edge ahead of its root's middle, in root chords
_ROOT, _WRIST, _OUTER, _TIP = (
    (0.0, 0.50, -0.50),
    (0.42, 0.72, -0.42),
    (0.75, 0.42, -0.36),
    (1.0, -0.28, -0.42),
)
# the outer wing follows the inner one by so much of a beat, and is drawn in on the way up
_LAG_RAD, _OUTER_GAIN, _FOLD = 0.9, 0.9, 0.3
_FADE_SHARE = 0.12
_MIRROR = np.array([1.0, -1.0, 1.0])
# parts without feathers: beak
_BEAK_BGR = (50.0, 110.0, 150.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Joints:
    """Angles of inner and outer wing above the level, rad, and how far the outer wing is drawn in, 0 to 1."""

    inner_rad: float
    outer_rad: float
    fold: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BirdForm:
    """A bird's triangles at one moment: ``corners_body_m`` (n, 3, 3) and unit ``normals_body`` (n, 3), outward."""

    corners_body_m: FloatArray
    normals_body: FloatArray


class BirdShape:
    """A bird's triangles at any moment of its beat; their number and order stay."""

    def __init__(self, spec: BirdSpec) -> None:
        self._spec = spec
        self._length_m = spec.length_per_span * spec.span_m
        body, colours = self._body()
        self._body_corners, self._body_normals = body, _normals(body)
        back, belly, tip = (np.array(c) for c in (spec.back_bgr, spec.belly_bgr, spec.tip_bgr))
        # three strips of two triangles on each side of each wing
        top = np.vstack([back, back, 0.5 * (back + tip), 0.5 * (back + tip), tip])
        under = np.vstack([belly, belly, belly, 0.5 * (belly + tip), 0.6 * tip + 0.4 * belly])
        self.colours_bgr = np.vstack([colours, top, under, top, under])
        self.opacity = np.ones(len(self.colours_bgr))

    @property
    def reach_m(self) -> float:
        """Largest distance of a corner from the middle, m."""
        return max(0.5 * self._spec.span_m, 0.6 * self._length_m) + self._spec.chord_per_span * self._spec.span_m

    def at(self, t_s: float, phase: float = 0.0) -> BirdForm:
        """Return its triangles at a time, s; ``phase`` is added to that of the bird's cycle."""
        upper = self._wing(self._joints(t_s, phase))
        # the other side, and the mirrored wing: their corners in the other order, so that they stay outward
        turned = upper[:, [0, 2, 1]]
        out = _normals(upper)
        return BirdForm(
            corners_body_m=np.concatenate([self._body_corners, upper, turned, turned * _MIRROR, upper * _MIRROR]),
            normals_body=np.concatenate([self._body_normals, out, -out, out * _MIRROR, -out * _MIRROR]),
        )

    def _joints(self, t_s: float, phase: float) -> _Joints:
        spec = self._spec
        turn = (t_s / spec.cycle_s + spec.phase + phase) % 1.0
        # flapping begins and ends within a share of the cycle
        begun = min(turn, spec.flapping_share - turn) / _FADE_SHARE
        strength = 1.0 if spec.flapping_share >= 1.0 else min(max(begun + 0.5, 0.0), 1.0)
        beat = math.tau * (spec.flap_hz * t_s + 3.0 * (spec.phase + phase))
        swing = strength * spec.flap_rad
        rest = spec.glide_rad + 0.15 * swing
        outer = rest + _OUTER_GAIN * swing * math.sin(beat - _LAG_RAD) - 0.3 * spec.glide_rad
        return _Joints(
            inner_rad=rest + swing * math.sin(beat),
            outer_rad=outer,
            fold=_FOLD * strength * max(math.cos(beat - 0.5 * _LAG_RAD), 0.0),
        )

    def _body(self) -> tuple[FloatArray, FloatArray]:
        """Return the corners and colours of body and tail."""
        spec, length = self._spec, self._length_m
        trunk = (1.0 - _TAIL_SHARE) * length
        angle = math.tau * np.arange(_RING_POINTS) / _RING_POINTS
        rings = [
            np.column_stack(
                [
                    np.full(_RING_POINTS, 0.5 * length - along * trunk),
                    trunk * half * np.cos(angle),
                    trunk * (-up + half * np.sin(angle)),
                ]
            )
            for along, half, up in _RINGS
        ]
        solid = loft(rings)
        middles = solid.mean(axis=1)
        upper = np.clip(0.5 - middles[:, 2] / (0.12 * trunk), 0.0, 1.0)[:, None]
        colours = upper * np.array(spec.back_bgr) + (1.0 - upper) * np.array(spec.belly_bgr)
        colours[middles[:, 0] > 0.5 * length - 0.07 * trunk] = _BEAK_BGR
        root, end = 0.5 * length - 0.93 * trunk, -0.5 * length
        wide, up = _TAIL_HALF_WIDTH * length, -0.02 * trunk
        narrow = 0.25 * wide
        fan = np.array(
            [
                [[root, -narrow, up], [root, narrow, up], [end, wide, up]],
                [[root, -narrow, up], [end, wide, up], [end, -wide, up]],
            ]
        )
        tail = np.concatenate([fan, fan[:, [0, 2, 1]]])
        above = doubled_areas(tail)[:, 2] < 0.0
        shades = np.where(above[:, None], np.array(spec.back_bgr), np.array(spec.belly_bgr))
        return np.concatenate([solid, tail]), np.vstack([colours, shades])

    def _wing(self, joints: _Joints) -> FloatArray:
        """Return the upper side of the right wing (5, 3, 3)."""
        half, chord = 0.5 * self._spec.span_m, self._spec.chord_per_span * self._spec.span_m
        side, down = 0.0, 0.0
        shoulder = 0.08 * self._length_m
        edges = []
        before = 0.0
        for number, (share, lead, trail) in enumerate((_ROOT, _WRIST, _OUTER, _TIP)):
            angle = joints.inner_rad if number <= 1 else joints.outer_rad
            drawn_in = 1.0 if number <= 1 else 1.0 - joints.fold
            step = (share - before) * half * drawn_in
            side, down, before = side + step * math.cos(angle), down - step * math.sin(angle), share
            back = 0.0 if number <= 1 else joints.fold * (share - _WRIST[0]) * half
            edges.append([[shoulder + chord * e - back, side, down - 0.04 * self._length_m] for e in (lead, trail)])
        points = np.array(edges)
        strips = []
        for near, far in ((0, 1), (1, 2)):
            (a, b), (c, d) = points[near], points[far]
            strips += [[a, b, c], [c, b, d]]
        (a, b), (c, d) = points[2], points[3]
        strips.append([a, b, 0.5 * (c + d)])
        return np.array(strips)


def _normals(triangles: FloatArray) -> FloatArray:
    """Return the unit normals (n, 3) of triangles (n, 3, 3); `numpy.cross` takes several times as long for so few."""
    a, b = (triangles[:, 1] - triangles[:, 0]).T, (triangles[:, 2] - triangles[:, 0]).T
    normals = np.column_stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
    return np.asarray(normals / np.maximum(np.sqrt((normals * normals).sum(axis=1)), 1e-12)[:, None])
