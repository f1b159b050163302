"""Closed parts of an airframe: bodies through rings of points, rods, wheels, and their assembly in the body frame.

Parts are given in wing spans, as behind the nose, to the right, and up.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.airframes.airframe import AircraftLight, Airframe

Colour = tuple[float, float, float]
_LEAST_AREA = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeshPart:
    """A closed part: ``triangles`` (n, 3, 3) outward, ``colours_bgr`` (n, 3), and one opacity or one of each (n,)."""

    triangles: FloatArray
    colours_bgr: FloatArray
    opacity: FloatArray | float = 1.0


def part(triangles: FloatArray, colour_bgr: Colour) -> MeshPart:
    """Return an opaque part of one colour."""
    return MeshPart(triangles=triangles, colours_bgr=np.tile(colour_bgr, (len(triangles), 1)))


def assembled(
    parts: Sequence[MeshPart], *, span_m: float, rest_height_per_span: float, lights: tuple[AircraftLight, ...] = ()
) -> Airframe:
    """Return the airframe of parts; triangles without area are left out."""
    corners = np.concatenate([p.triangles for p in parts])
    colours = np.concatenate([p.colours_bgr for p in parts])
    opacity = np.concatenate([np.broadcast_to(p.opacity, len(p.triangles)) for p in parts])
    normals = doubled_areas(corners)
    area = np.linalg.norm(normals, axis=1)
    kept = area > _LEAST_AREA
    # two axes are turned round, so that the order of the corners stays outward
    to_body = np.array([-span_m, span_m, -span_m])
    return Airframe(
        corners_body_m=corners[kept] * to_body,
        normals_body=normals[kept] / area[kept, None] * np.sign(to_body),
        colours_bgr=colours[kept],
        opacity=np.asarray(opacity[kept], dtype=np.float64),
        span_m=span_m,
        rest_height_m=rest_height_per_span * span_m,
        lights=lights,
    )


def doubled_areas(triangles: FloatArray) -> FloatArray:
    """Return the normals (n, 3) of triangles (n, 3, 3), twice their area long."""
    return np.asarray(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]))


def volume(triangles: FloatArray) -> float:
    """Return the volume that closed triangles (n, 3, 3) enclose; negative where they are inside out."""
    triangles = triangles - triangles.reshape(-1, 3).mean(axis=0)
    return float(np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])) / 6.0)


def loft(rings: Sequence[FloatArray]) -> FloatArray:
    """Return the outward triangles (n, 3, 3) of a closed body through rings (m, 3) of equally many points."""
    triangles = []
    count = len(rings[0])
    for near, far in itertools.pairwise(rings):
        for k in range(count):
            after = (k + 1) % count
            triangles += [(near[k], far[k], far[after]), (near[k], far[after], near[after])]
    first, last = rings[0], rings[-1]
    middle = first.mean(axis=0)
    triangles += [(middle, first[k], first[(k + 1) % count]) for k in range(count)]
    middle = last.mean(axis=0)
    triangles += [(middle, last[(k + 1) % count], last[k]) for k in range(count)]
    body = np.array(triangles)
    return body if volume(body) >= 0.0 else turned(body)


def turned(triangles: FloatArray) -> FloatArray:
    """Return triangles (n, 3, 3) with their corners in the other order."""
    return triangles[:, [0, 2, 1]]


def mirrored(triangles: FloatArray) -> FloatArray:
    """Return the outward triangles (n, 3, 3) of the same body on the other side."""
    return turned(triangles * np.array([1.0, -1.0, 1.0]))


def rod(start: FloatArray, end: FloatArray, radius: float) -> FloatArray:
    """Return a hexagonal rod between two points (3,) that do not lie one behind the other."""
    along = (end - start) / np.linalg.norm(end - start)
    aside = np.cross(along, [1.0, 0.0, 0.0])
    aside /= np.linalg.norm(aside)
    other = np.cross(along, aside)
    angle = 2.0 * np.pi * np.arange(6) / 6
    ring = radius * (np.outer(np.cos(angle), aside) + np.outer(np.sin(angle), other))
    return loft([start + ring, end + ring])


def wheel(middle: FloatArray, radius: float = 0.02, half_width: float = 0.008) -> FloatArray:
    """Return a wheel about a point (3,), its axle to the right."""
    angle = 2.0 * np.pi * np.arange(12) / 12
    ring = np.column_stack([radius * np.cos(angle), np.zeros(12), radius * np.sin(angle)])
    width = np.array([0.0, half_width, 0.0])
    return loft([middle - width + ring, middle + width + ring])
