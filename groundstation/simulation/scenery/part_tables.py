"""A scenery's objects from one camera: lit, turned, sorted, with their shadows."""

import itertools
import math

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import cross
from groundstation.simulation.scenery import texture_kernels as textures
from groundstation.simulation.scenery.object_faces import Face, Part, object_parts
from groundstation.simulation.scenery.part_kernels import FaceTable, PartTable
from groundstation.simulation.scenery.scenery import Scenery

# an object that contains a station or is right before one is left out
_CLEAR_OF_EYE_M = 5.0
_THINNEST_PX = 1.2
_LEAFY = (textures.FOREST, textures.CONIFERS, textures.TREE, textures.CONIFER, textures.HEDGE)
_LOWEST_SUN_RAD = math.radians(5.0)
_ON_GROUND_M = 0.02


class _Seen:
    """A face from one camera; corners in m from the camera."""

    def __init__(self, face: Face, corners: FloatArray, colours: FloatArray, opacity: float, seed: int) -> None:
        self.face, self.corners, self.colours, self.opacity, self.seed = face, corners, colours, opacity, seed
        self.gap = _gap(corners)
        along = corners[1] - corners[0]
        self.along = along / max(float(np.linalg.norm(along)), 1e-9)
        up = corners[3] - corners[0]
        if np.linalg.norm(up) < 1e-6:
            up = corners[2] - corners[1]
        normal = cross(self.along, up)
        self.normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
        self.up = cross(self.normal, self.along)
        across = corners - corners[0]
        self.size = np.array([(across @ self.along).max(), (across @ self.up).max()])


def part_tables_of(scenery: Scenery, eye: FloatArray, pixel_rad: float) -> tuple[PartTable, FaceTable]:
    """Return all objects and their shadows from a camera at (3,) m with pixels of so many rad."""
    shadows: list[list[_Seen]] = []
    parts: list[tuple[float, list[_Seen]]] = []
    for number, thing in enumerate(scenery.objects):
        for part in object_parts(thing):
            seen = _seen(scenery, part, eye, pixel_rad, scenery.seed + 17 * number)
            if not seen:
                continue
            middle = np.concatenate([s.corners for s in seen])[:, :2].mean(axis=0)
            parts.append((-float(np.hypot(*middle)), seen))
            if scenery.light.shadow > 0.0:
                shadows += _shadow(scenery, part, eye)
    parts.sort(key=lambda part: part[0])
    return _packed([*shadows, *(seen for _, seen in parts)])


def _seen(scenery: Scenery, part: Part, eye: FloatArray, pixel_rad: float, seed: int) -> list[_Seen]:
    found = []
    for face in part:
        corners, opacity = _turned(face, eye, pixel_rad)
        seen = _Seen(face, corners, np.zeros((2, 3)), opacity, seed & 0x7FFFFFFF)
        if seen.gap < _CLEAR_OF_EYE_M:
            return []
        if face.outward and seen.normal @ corners[0] >= 0.0:
            continue
        seen.colours = _lit(scenery, face, seen.normal, corners)
        found.append(seen)
    return found


def _gap(corners: FloatArray) -> float:
    """Return how close a face (4, 3) comes to the eye in plan, m."""
    best = math.inf
    foot = corners[:, :2].tolist()
    for (x, y), (x_next, y_next) in itertools.pairwise([*foot, foot[0]]):
        dx, dy = x_next - x, y_next - y
        length = dx * dx + dy * dy
        part = min(max(-(x * dx + y * dy) / length, 0.0), 1.0) if length > 0.0 else 0.0
        best = min(best, math.hypot(x + part * dx, y + part * dy))
    return best


def _turned(face: Face, eye: FloatArray, pixel_rad: float) -> tuple[FloatArray, float]:
    """Return a face's corners from the camera and its opacity, reduced for a face thinner than a pixel."""
    corners = face.corners - eye
    if not face.towards_eye:
        return corners, 1.0
    middle = corners[:2].mean(axis=0)
    away = float(np.hypot(middle[0], middle[1]))
    width = float(np.linalg.norm(corners[1] - corners[0]))
    shown = max(width, _THINNEST_PX * pixel_rad * away) if face.texture == textures.ROUND else width
    aside = np.array([middle[1], -middle[0], 0.0]) / max(away, 1e-9)
    height = np.array([0.0, 0.0, corners[3, 2] - corners[0, 2]])
    left, right = middle - 0.5 * shown * aside, middle + 0.5 * shown * aside
    return np.array([left, right, right + height, left + height]), width / shown


def _lit(scenery: Scenery, face: Face, normal: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the two colours (2, 3) in the scenery's light."""
    colours = np.array([face.colour, face.second])
    sun = scenery.sun_runway
    view = corners.mean(axis=0)
    if face.texture in _LEAFY:
        # crowns have facets of all directions: bright where the sun is behind the eye
        level = view[:2] / max(float(np.hypot(view[0], view[1])), 1e-9)
        front = 0.5 - 0.5 * float(level @ sun[:2])
        light = scenery.light
        bright = np.array(light.ambient_bgr) + np.array(light.from_sky_bgr) + np.array(light.sun_bgr) * (0.2 + front)
        return colours * bright
    if face.texture == textures.ROUND:
        # the sides that are seen: left and right edge
        aside = np.array([view[1], -view[0], 0.0]) / max(float(np.hypot(view[0], view[1])), 1e-9)
        facing = -np.array([view[0], view[1], 0.0]) / max(float(np.hypot(view[0], view[1])), 1e-9)
        sides = np.array([facing - aside, facing + aside]) / math.sqrt(2.0)
        return np.array([face.colour, face.colour]) * scenery.light_on(sides)
    if normal @ view > 0.0:
        normal = -normal
    return np.asarray(colours * scenery.light_on(normal[None]))


def _shadow(scenery: Scenery, part: Part, eye: FloatArray) -> list[list[_Seen]]:
    """Return the shadow of a part on the ground: quadrilaterals that make up its outline."""
    elevation = max(scenery.sun_elevation_rad, _LOWEST_SUN_RAD)
    towards = np.array([math.sin(scenery.sun_azimuth_rad), math.cos(scenery.sun_azimuth_rad)])
    points = np.concatenate([_solid(face, towards) for face in part])
    ground = points[:, :2] - np.maximum(points[:, 2:], 0.0) / math.tan(elevation) * towards
    hull = _hull(ground)
    if len(hull) < 3:
        return []
    lifted = np.column_stack([hull, np.full(len(hull), _ON_GROUND_M)]) - eye
    pieces = []
    for k in range(1, len(lifted) - 1, 2):
        last = min(k + 2, len(lifted) - 1)
        corners = lifted[[0, k, k + 1, last]]
        face = Face(corners=corners, texture=textures.SHADOW, colour=(0.0,) * 3, second=(0.0,) * 3)
        pieces.append(_Seen(face, corners, np.zeros((2, 3)), scenery.light.shadow, 0))
    return [pieces]


def _solid(face: Face, towards: FloatArray) -> FloatArray:
    """Return points (n, 3) with the outline of a face's shadow; a crown's differs from its rectangle's."""
    if not face.towards_eye:
        return face.corners
    middle, half = face.corners[:2].mean(axis=0), 0.5 * float(np.linalg.norm(face.corners[1] - face.corners[0]))
    height = float(face.corners[3, 2])
    aside = np.array([towards[1], -towards[0], 0.0])
    if face.texture == textures.ROUND:
        outline = [(-1.0, 0.0), (1.0, 0.0), (1.0, 1.0), (-1.0, 1.0)]
    elif face.texture == textures.CONIFER:
        outline = [(-1.0, 0.06), (1.0, 0.06), (0.0, 1.0)]
    else:
        outline = [(math.cos(a), 0.6 + 0.4 * math.sin(a)) for a in np.linspace(0.0, 5.6, 9)]
    return np.array([middle + u * half * aside + (0.0, 0.0, v * height) for u, v in outline])


def _hull(points: FloatArray) -> FloatArray:
    """Return the convex hull (n, 2), counter-clockwise, of points in a plane (monotone chain)."""
    ordered = sorted({(float(x), float(y)) for x, y in points})

    def chain(line: list[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for x, y in line:
            while len(kept) > 1:
                (ax, ay), (bx, by) = kept[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                    break
                kept.pop()
            kept.append((x, y))
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def _packed(parts: list[list[_Seen]]) -> tuple[PartTable, FaceTable]:
    faces = [seen for part in parts for seen in part]
    counts = np.array([len(part) for part in parts], np.int64)
    ends = np.cumsum(counts)
    spans = np.array([_azimuths(part) for part in parts]).reshape(-1, 2)
    table = PartTable(first=ends - counts, end=ends, azimuth_from=spans[:, 0].copy(), azimuth_to=spans[:, 1].copy())
    corners = np.array([s.corners for s in faces]).reshape(-1, 4, 3)
    gaps = np.array([s.gap for s in faces])
    return table, FaceTable(
        corners=corners,
        normal=np.array([s.normal for s in faces]).reshape(-1, 3),
        along=np.array([s.along for s in faces]).reshape(-1, 3),
        up=np.array([s.up for s in faces]).reshape(-1, 3),
        kind=np.array([s.face.texture for s in faces], np.int64),
        colour=np.array([s.colours[0] for s in faces]).reshape(-1, 3),
        second=np.array([s.colours[1] for s in faces]).reshape(-1, 3),
        size=np.array([s.size for s in faces]).reshape(-1, 2),
        offset=np.array([s.face.offset_m for s in faces], np.float64),
        opacity=np.array([s.opacity for s in faces], np.float64),
        nearest=np.maximum(gaps, 0.5),
        farthest=np.linalg.norm(corners, axis=2).max(axis=1, initial=0.5),
        seed=np.array([s.seed for s in faces], np.int64),
    )


def _azimuths(part: list[_Seen]) -> tuple[float, float]:
    """Return azimuths between which a part is seen, the second less than a turn after the first."""
    corners = np.concatenate([s.corners for s in part])
    angles = np.arctan2(corners[:, 0], corners[:, 1])
    off = (angles - angles[0] + math.pi) % math.tau - math.pi
    # from inside a shadow's outline it is visible in all directions
    if off.max() - off.min() >= math.pi:
        return -math.pi, math.pi
    return float(angles[0] + off.min()), float(angles[0] + off.max())
