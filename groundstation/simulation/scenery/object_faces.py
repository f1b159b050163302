"""Shapes of scenery objects: convex parts of flat faces, runway frame, not yet lit."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.scenery import texture_kernels as textures
from groundstation.simulation.scenery.scenery_objects import ObjectKind, SceneryObject
from groundstation.simulation.scenery.surfaces import Colour

_PIECE_M = 20.0
_GLASS, _TYRE = (62.0, 54.0, 48.0), (30.0, 30.0, 30.0)
_WIRE_SAG = 0.02
_SOCK_BANDS = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Face:
    """A flat face: corners (4, 3) m, the first two along its foot; its texture and colours in full light.

    ``outward`` faces are seen from their outer side only. ``towards_eye`` faces are turned about the middle of their
    foot until they face the eye. ``offset_m`` is where its texture starts.
    """

    corners: FloatArray
    texture: int
    colour: Colour
    second: Colour
    outward: bool = True
    towards_eye: bool = False
    offset_m: float = 0.0


Part = list[Face]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Frame:
    """An object's own axes on the ground: along its length, to its right, up."""

    x_m: float
    y_m: float
    heading_rad: float

    def points(self, along: FloatArray, right: FloatArray, up: FloatArray) -> FloatArray:
        sine, cosine = math.sin(self.heading_rad), math.cos(self.heading_rad)
        return np.column_stack([self.x_m + along * sine + right * cosine, self.y_m + along * cosine - right * sine, up])


def object_parts(thing: SceneryObject) -> list[Part]:
    """Return the convex parts of an object."""
    frame = _Frame(x_m=thing.x_m, y_m=thing.y_m, heading_rad=thing.heading_rad)
    kind = thing.kind
    if kind in (ObjectKind.HOUSE, ObjectKind.HALL, ObjectKind.HANGAR):
        return [_gabled(thing, frame)]
    if kind in (ObjectKind.BLOCK, ObjectKind.CONTAINER):
        texture = textures.WALL if kind is ObjectKind.BLOCK else textures.PLAIN
        size = (thing.length_m, thing.width_m)
        return [_box(frame, (0.0, 0.0), size, (0.0, thing.height_m), texture, thing.colour_bgr, thing.second_bgr)]
    if kind in (ObjectKind.CAR, ObjectKind.VAN):
        return _vehicle(thing, frame)
    if kind in (ObjectKind.TREE, ObjectKind.CONIFER, ObjectKind.POLE, ObjectKind.CHIMNEY, ObjectKind.SILO):
        return [[_standing(thing)]]
    if kind in (ObjectKind.FOREST, ObjectKind.CONIFERS, ObjectKind.HEDGE, ObjectKind.FENCE):
        return _strip(thing, frame)
    composed = {
        ObjectKind.TOWER: _tower,
        ObjectKind.WIRE: _wire,
        ObjectKind.WIND_SOCK: _wind_sock,
        ObjectKind.CONE: _cone,
    }
    return composed[kind](thing, frame)


def _quad(points: FloatArray, texture: int, colour: Colour, second: Colour) -> Face:
    return Face(corners=points, texture=texture, colour=colour, second=second)


def _box(
    frame: _Frame,
    middle: tuple[float, float],
    size: tuple[float, float],
    heights: tuple[float, float],
    texture: int,
    colour: Colour,
    second: Colour,
) -> Part:
    """Return four walls and a top; middle and size are along and across the object."""
    a, r = 0.5 * size[0], 0.5 * size[1]
    foot = [(-a, r), (a, r), (a, -r), (-a, -r)]
    faces = []
    for (a0, r0), (a1, r1) in itertools.pairwise([*foot, foot[0]]):
        along, right = middle[0] + np.array([a0, a1, a1, a0]), middle[1] + np.array([r0, r1, r1, r0])
        up = np.array([heights[0], heights[0], heights[1], heights[1]])
        faces.append(_quad(frame.points(along, right, up), texture, colour, second))
    along, right = middle[0] + np.array([p[0] for p in foot]), middle[1] + np.array([p[1] for p in foot])
    faces.append(_quad(frame.points(along, right, np.full(4, heights[1])), textures.PLAIN, colour, second))
    return faces


def _gabled(thing: SceneryObject, frame: _Frame) -> Part:
    """Return a building with a ridge along its length; a hall's is low, a hangar's has a door at its front."""
    steep = {ObjectKind.HOUSE: 0.42, ObjectKind.HALL: 0.14, ObjectKind.HANGAR: 0.22}[thing.kind]
    rise = min(steep * thing.width_m, 0.6 * thing.height_m)
    eaves = thing.height_m - rise
    texture = textures.WALL if thing.kind is ObjectKind.HOUSE else textures.PLAIN
    walls = _box(frame, (0.0, 0.0), (thing.length_m, thing.width_m), (0.0, eaves), texture, thing.colour_bgr, _GLASS)[
        :4
    ]
    a, r = 0.5 * thing.length_m, 0.5 * thing.width_m
    faces = list(walls)
    for side in (1.0, -1.0):
        roof = frame.points(
            side * np.array([-a, a, a, -a]),
            np.array([r, r, 0.0, 0.0]) * side,
            np.array([eaves, eaves, *[eaves + rise] * 2]),
        )
        faces.append(_quad(roof, textures.ROOF, thing.second_bgr, thing.second_bgr))
        gable = frame.points(
            np.full(4, side * a), side * np.array([r, -r, 0.0, 0.0]), np.array([eaves, eaves, *[eaves + rise] * 2])
        )
        faces.append(_quad(gable, textures.PLAIN, thing.colour_bgr, thing.colour_bgr))
    return faces


def _vehicle(thing: SceneryObject, frame: _Frame) -> list[Part]:
    """Return wheels' shadow gap, body and cabin of a car or a van."""
    size, height, colour = (thing.length_m, thing.width_m), thing.height_m, thing.colour_bgr
    van = thing.kind is ObjectKind.VAN
    waist = 0.62 * height if van else 0.55 * height
    under = _box(frame, (0.0, 0.0), (0.9 * size[0], 0.9 * size[1]), (0.0, 0.2), textures.PLAIN, _TYRE, _TYRE)
    body = _box(frame, (0.0, 0.0), size, (0.2, waist), textures.PLAIN, colour, colour)
    share = 0.9 if van else 0.55
    cabin = (share * size[0], 0.9 * size[1])
    glass = _box(frame, (-0.04 * size[0], 0.0), cabin, (waist, 0.92 * height), textures.PLAIN, _GLASS, _GLASS)
    roof = _box(frame, (-0.04 * size[0], 0.0), cabin, (0.92 * height, height), textures.PLAIN, colour, colour)
    return [under, body, glass, roof]


def _standing(thing: SceneryObject) -> Face:
    """Return the upright face, turned towards the camera, of a rotationally symmetric object."""
    texture = {ObjectKind.TREE: textures.TREE, ObjectKind.CONIFER: textures.CONIFER}.get(thing.kind, textures.ROUND)
    half = 0.5 * thing.width_m
    foot = np.array([[-half, 0.0, 0.0], [half, 0.0, 0.0]]) + np.array([thing.x_m, thing.y_m, 0.0])
    corners = np.vstack([foot, foot[::-1] + np.array([0.0, 0.0, thing.height_m])])
    dark = tuple(0.6 * part for part in thing.colour_bgr)
    second = thing.second_bgr if texture != textures.ROUND else (dark[0], dark[1], dark[2])
    return Face(
        corners=corners, texture=texture, colour=thing.colour_bgr, second=second, outward=False, towards_eye=True
    )


def _strip(thing: SceneryObject, frame: _Frame) -> list[Part]:
    """Return pieces of a wall; a forest as deep as it is wide has several rows of trees."""
    texture = {
        ObjectKind.FOREST: textures.FOREST,
        ObjectKind.CONIFERS: textures.CONIFERS,
        ObjectKind.HEDGE: textures.HEDGE,
        ObjectKind.FENCE: textures.FENCE,
    }[thing.kind]
    rows = [0.0] if texture in (textures.FENCE, textures.HEDGE) else [-0.5, 0.0, 0.5]
    edges = np.linspace(-0.5, 0.5, max(math.ceil(thing.length_m / _PIECE_M), 1) + 1) * thing.length_m
    parts: list[Part] = []
    for number, row in enumerate(rows):
        for start, end in itertools.pairwise(edges.tolist()):
            along, across = np.array([start, end, end, start]), np.full(4, row * thing.width_m)
            up = np.array([0.0, 0.0, thing.height_m, thing.height_m])
            face = Face(
                corners=frame.points(along, across, up),
                texture=texture,
                colour=thing.colour_bgr,
                second=thing.second_bgr,
                outward=False,
                offset_m=start + 0.5 * thing.length_m + 1000.0 * number,
            )
            parts.append([face])
    return parts


def _tower(thing: SceneryObject, frame: _Frame) -> list[Part]:
    """Return a control tower: shaft, glazed cab, roof."""
    size, height = (thing.length_m, thing.width_m), thing.height_m
    cab = (1.5 * size[0], 1.5 * size[1])
    shaft = _box(frame, (0.0, 0.0), size, (0.0, 0.75 * height), textures.WALL, thing.colour_bgr, _GLASS)
    glass = _box(frame, (0.0, 0.0), cab, (0.75 * height, 0.92 * height), textures.PLAIN, _GLASS, _GLASS)
    roof = _box(frame, (0.0, 0.0), cab, (0.92 * height, height), textures.PLAIN, thing.second_bgr, thing.second_bgr)
    return [shaft, glass, roof]


def _wire(thing: SceneryObject, frame: _Frame) -> list[Part]:
    """Return a wire that hangs between two heads of poles."""
    count = 16
    along = np.linspace(-0.5, 0.5, count + 1) * thing.length_m
    sag = _WIRE_SAG * thing.length_m
    height = thing.height_m - sag * (1.0 - (2.0 * along / thing.length_m) ** 2)
    half = 0.5 * thing.width_m
    parts: list[Part] = []
    for k in range(count):
        up = np.array([height[k] - half, height[k + 1] - half, height[k + 1] + half, height[k] + half])
        points = frame.points(along[[k, k + 1, k + 1, k]], np.zeros(4), up)
        parts.append(
            [
                Face(
                    corners=points,
                    texture=textures.PLAIN,
                    colour=thing.colour_bgr,
                    second=thing.colour_bgr,
                    outward=False,
                )
            ]
        )
    return parts


def _ring(frame: _Frame, along: float, up: float, radius: float, upright: bool) -> FloatArray:
    """Return eight points of a circle across the length (upright) or level, (8, 3)."""
    angle = 2.0 * np.pi * np.arange(8) / 8
    if upright:
        return frame.points(np.full(8, along), radius * np.cos(angle), up + radius * np.sin(angle))
    return frame.points(along + radius * np.cos(angle), radius * np.sin(angle), np.full(8, up))


def _around(low: FloatArray, high: FloatArray, colour: Colour) -> Part:
    """Return the faces between two rings (8, 3); each is seen from both sides, the near one covers the far one."""
    faces = []
    for k in range(8):
        after = (k + 1) % 8
        faces.append(_quad(np.array([low[k], low[after], high[after], high[k]]), textures.PLAIN, colour, colour))
    return faces


def _wind_sock(thing: SceneryObject, frame: _Frame) -> list[Part]:
    """Return a mast and a tapered sock of coloured bands that the wind along its heading fills."""
    pole = _box(
        frame, (0.0, 0.0), (0.12, 0.12), (0.0, thing.height_m), textures.PLAIN, (190.0, 190.0, 190.0), thing.second_bgr
    )
    length, mouth = thing.length_m, 0.5 * thing.width_m
    parts = [pole]
    for band in range(_SOCK_BANDS):
        ends = [band / _SOCK_BANDS, (band + 1) / _SOCK_BANDS]
        # it hangs a little towards its end
        low, high = (
            _ring(
                frame, 0.1 + e * length, thing.height_m - mouth - 0.25 * length * e * e, mouth * (1.0 - 0.5 * e), True
            )
            for e in ends
        )
        parts.append(_around(low, high, thing.colour_bgr if band % 2 == 0 else thing.second_bgr))
    return parts


def _cone(thing: SceneryObject, frame: _Frame) -> list[Part]:
    """Return a marker cone."""
    low = _ring(frame, 0.0, 0.0, 0.5 * thing.width_m, False)
    high = _ring(frame, 0.0, thing.height_m, 0.06 * thing.width_m, False)
    return [_around(low, high, thing.colour_bgr)]
