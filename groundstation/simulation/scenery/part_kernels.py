"""Compiled drawing of objects into a panorama, far ones first: convex parts of flat faces with simple textures.

Every column of the panorama is a vertical half-plane. Its intersection with a face is a segment, and its elevations are
exact; four such cuts a column smooth upright edges, and rows are covered by the share inside.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray
from groundstation.simulation.occlusion_kernels import DEPTH_STEP_M, NO_OBJECT
from groundstation.simulation.scenery.noise_kernels import glow
from groundstation.simulation.scenery.texture_kernels import SHADOW, texture
from groundstation.simulation.scenery.tones import SkyTones

MAX_FACES = 64  # of one part
_CUTS = 4
_NEAREST_M = 0.05
_LEAST_SHARE = 0.002


class FaceTable(NamedTuple):
    """Flat faces (n): corners (n, 4, 3) m from the eye, unit normals and texture axes (n, 3), colours BGR as lit.

    ``size`` (n, 2) m is the texture's extent, ``offset`` (n,) m where along its first axis it starts, ``nearest`` and
    ``farthest`` (n,) m bound the distance.
    """

    corners: FloatArray
    normal: FloatArray
    along: FloatArray
    up: FloatArray
    kind: np.ndarray
    colour: FloatArray
    second: FloatArray
    size: FloatArray
    offset: FloatArray
    opacity: FloatArray
    nearest: FloatArray
    farthest: FloatArray
    seed: np.ndarray


class PartTable(NamedTuple):
    """Parts (n), far ones first: faces ``first`` to ``end``, and azimuths that hold them, rad."""

    first: np.ndarray
    end: np.ndarray
    azimuth_from: FloatArray
    azimuth_to: FloatArray


@njit(cache=True, nogil=True, forceinline=True)
def _cut(corners: FloatArray, k: int, azimuth: float, out: FloatArray) -> bool:
    """Fill the lowest and highest elevation (2,) at which face k is seen under an azimuth; False where it is not."""
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    out[0], out[1] = np.inf, -np.inf
    for i in range(4):
        j = (i + 1) & 3
        aside = corners[k, i, 0] * cosine - corners[k, i, 1] * sine
        other = corners[k, j, 0] * cosine - corners[k, j, 1] * sine
        if aside * other > 0.0 or aside == other:
            continue
        part = aside / (aside - other)
        x = corners[k, i, 0] + part * (corners[k, j, 0] - corners[k, i, 0])
        y = corners[k, i, 1] + part * (corners[k, j, 1] - corners[k, i, 1])
        z = corners[k, i, 2] + part * (corners[k, j, 2] - corners[k, i, 2])
        ahead = x * sine + y * cosine
        if ahead > _NEAREST_M:
            elevation = np.arctan2(z, ahead)
            out[0], out[1] = min(out[0], elevation), max(out[1], elevation)
    return out[1] > out[0]


@njit(cache=True, nogil=True, forceinline=True)
def _shade(
    faces: FaceTable, k: int, azimuth: float, elevation: float, pixel: float, sky: SkyTones, c: FloatArray
) -> tuple[float, float]:
    """Set the colour of face k in a direction; return its opacity and its distance, m."""
    level = np.cos(elevation)
    dx, dy, dz = level * np.sin(azimuth), level * np.cos(azimuth), np.sin(elevation)
    normal, origin = faces.normal[k], faces.corners[k, 0]
    facing = normal[0] * dx + normal[1] * dy + normal[2] * dz
    plane = normal[0] * origin[0] + normal[1] * origin[1] + normal[2] * origin[2]
    distance = plane / facing if abs(facing) > 1e-9 else faces.nearest[k]
    distance = min(max(distance, faces.nearest[k]), faces.farthest[k])
    px, py, pz = distance * dx - origin[0], distance * dy - origin[1], distance * dz - origin[2]
    along, up = faces.along[k], faces.up[k]
    u = min(max(px * along[0] + py * along[1] + pz * along[2], 0.0), faces.size[k, 0]) + faces.offset[k]
    v = min(max(px * up[0] + py * up[1] + pz * up[2], 0.0), faces.size[k, 1])
    opacity = faces.opacity[k] * texture(
        faces.kind[k], u, v, faces.size[k], distance * pixel, faces.seed[k], faces.colour[k], faces.second[k], c
    )
    clear = np.exp(-distance / sky.extinction)
    more = 0.0
    if sky.glow > 0.0:
        more = 0.5 * glow(dx * sky.sun.x + dy * sky.sun.y + dz * sky.sun.z, sky.glow)
    c[0] = clear * c[0] + (1.0 - clear) * (sky.air.b + more)
    c[1] = clear * c[1] + (1.0 - clear) * (sky.air.g + more)
    c[2] = clear * c[2] + (1.0 - clear) * (sky.air.r + more)
    return opacity, distance


@njit(cache=True, nogil=True, forceinline=True)
def _cuts(
    faces: FaceTable, first: int, end: int, azimuth: float, top: float, density: float, cuts: FloatArray
) -> tuple[int, int]:
    """Fill the rows (faces, cuts, 2) between which each face is visible in a column's cuts; return their range."""
    found = np.empty(2)
    low, high = np.inf, -np.inf
    for k in range(first, end):
        for s in range(_CUTS):
            cuts[k - first, s, 0] = cuts[k - first, s, 1] = 0.0
            if _cut(faces.corners, k, azimuth + ((s + 0.5) / _CUTS - 0.5) / density, found):
                above, below = (top - found[1]) * density, (top - found[0]) * density
                cuts[k - first, s, 0], cuts[k - first, s, 1] = above, below
                low, high = min(low, above), max(high, below)
    if high <= low:
        return 0, -1
    return int(np.floor(max(low, -1e6) + 0.5)), int(np.floor(min(high, 1e6) + 0.5))


@njit(cache=True, nogil=True, forceinline=True)
def _column(
    faces: FaceTable,
    first: int,
    end: int,
    place: FloatArray,
    column: int,
    first_row: int,
    sky: SkyTones,
    cuts: FloatArray,
    room: FloatArray,
) -> tuple[int, int]:
    """Fill rows (h, 5) of B, G, R times cover, cover, and distance, m; return which of them hold the part.

    ``room`` starts at the panorama's ``first_row``.
    """
    azimuth, density = place[0] + column / place[2], place[2]
    low, high = _cuts(faces, first, end, azimuth, place[1], density, cuts)
    low, high = max(low - first_row, 0), min(high - first_row, room.shape[0] - 1)
    c = np.empty(3)
    for place_in_room in range(low, high + 1):
        row = first_row + place_in_room
        room[place_in_room, :] = 0.0
        elevation = place[1] - row / density
        for k in range(first, end):
            share = 0.0
            for s in range(_CUTS):
                share += max(min(cuts[k - first, s, 1], row + 0.5) - max(cuts[k - first, s, 0], row - 0.5), 0.0)
            share /= _CUTS
            if share < _LEAST_SHARE:
                continue
            opacity, distance = _shade(faces, k, azimuth, elevation, 1.0 / density, sky, c)
            share *= opacity
            for n in range(3):
                room[place_in_room, n] += share * c[n]
            room[place_in_room, -2] += share
            room[place_in_room, -1] = distance
    return low, high


@njit(cache=True, nogil=True)
def draw_parts(
    place: FloatArray,
    corner: np.ndarray,
    parts: PartTable,
    faces: FaceTable,
    sky: SkyTones,
    grey: bool,
    image: ImageArray,
    depth: np.ndarray,
) -> None:
    """Draw parts over a part (h, w, 3) of a panorama with its depth (h, w).

    ``place`` is the panorama's, ``corner`` (2,) the row and column of the first pixel.
    """
    height, width = depth.shape
    first_row, first_column = corner[0], corner[1]
    room, cuts = np.empty((height, 5)), np.empty((MAX_FACES, _CUTS, 2))
    colour = np.empty(3)
    for part in range(len(parts.first)):
        first, end = parts.first[part], parts.end[part]
        solid = faces.kind[first] != SHADOW
        for turn in range(-1, 2):
            start = (parts.azimuth_from[part] + 2.0 * np.pi * turn - place[0]) * place[2]
            stop = (parts.azimuth_to[part] + 2.0 * np.pi * turn - place[0]) * place[2]
            left = max(int(np.floor(start)) - 1 - first_column, 0)
            right = min(int(np.ceil(stop)) + 2 - first_column, width)
            for column in range(left, right):
                low, high = _column(faces, first, end, place, first_column + column, first_row, sky, cuts, room)
                for row in range(low, high + 1):
                    share = room[row, -2]
                    if share < _LEAST_SHARE:
                        continue
                    covered = min(share, 1.0)
                    for n in range(3):
                        colour[n] = room[row, n] / share
                    if grey:
                        colour[:] = 0.114 * colour[0] + 0.587 * colour[1] + 0.299 * colour[2]
                    for n in range(3):
                        mixed = (1.0 - covered) * image[row, column, n] + covered * colour[n] + 0.5
                        image[row, column, n] = np.uint8(min(max(mixed, 0.0), 255.0))
                    if solid and covered >= 0.5:
                        depth[row, column] = np.uint16(min(room[row, -1] / DEPTH_STEP_M, NO_OBJECT - 1.0))
