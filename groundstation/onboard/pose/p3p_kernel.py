"""Compiled start of the solver: the exact poses of three of the points, evaluated on all of them.

Grunert's quartic as in Haralick, Lee, Ottenberg and Nölle, "Review and analysis of solutions of the three point
perspective pose estimation problem", 1994.
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, IntArray
from groundstation.onboard.pose.camera_kernel import dual_of
from groundstation.onboard.pose.levenberg_marquardt import reprojection_residuals


@njit(cache=True)
def three_point_depths(a2: float, b2: float, c2: float, ca: float, cb: float, cg: float) -> FloatArray:
    """Return distances (4, 3) along three rays; a², b², c² opposite points 1, 2, 3, and the cosines between rays.

    Roots made complex by noise are replaced by their real part: they are initial values. Rows of zeros are unused.
    """
    p, m, s = (a2 - c2) / b2, c2 / b2, (a2 + c2) / b2
    k = a2 / b2
    quartic = np.array(
        [
            (p - 1.0) ** 2 - 4.0 * m * ca * ca,
            4.0 * (p * (1.0 - p) * cb - (1.0 - s) * ca * cg + 2.0 * m * ca * ca * cb),
            2.0 * (p * p - 1.0 + 2.0 * p * p * cb * cb + 2.0 * (1.0 - m) * ca * ca - 4.0 * s * ca * cb * cg
                   + 2.0 * (1.0 - k) * cg * cg),
            4.0 * (-p * (1.0 + p) * cb + 2.0 * k * cg * cg * cb - (1.0 - s) * ca * cg),
            (1.0 + p) ** 2 - 4.0 * k * cg * cg,
        ]
    )  # fmt: skip
    depths = np.zeros((4, 3))
    if not np.isfinite(quartic).all() or abs(quartic[0]) < 1e-14 * np.abs(quartic).max():
        return depths
    companion = np.zeros((4, 4), dtype=np.complex128)
    for i in range(4):
        companion[0, i] = -quartic[1 + i] / quartic[0]
        if i < 3:
            companion[i + 1, i] = 1.0
    roots = np.linalg.eigvals(companion)
    for i in range(4):
        v = roots[i].real
        below = 2.0 * (cg - v * ca)
        square = 1.0 + v * v - 2.0 * v * cb
        if v <= 0.0 or abs(below) < 1e-12 or square <= 0.0:
            continue
        u = ((p - 1.0) * v * v - 2.0 * p * cb * v + 1.0 + p) / below
        if u <= 0.0:
            # a complex pair has no u of its own; the side c gives it from v: u² − 2 u cos γ + 1 = c² (1 + v² …) / b²
            u = cg
        first = np.sqrt(b2 / square)
        depths[i, 0], depths[i, 1], depths[i, 2] = first, u * first, v * first
    return depths


@njit(cache=True)
def dot(a: FloatArray, b: FloatArray) -> float:
    """Return a · b of vectors (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Fill a × b of vectors (3,)."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def triangle_axes(corners: FloatArray, axes: FloatArray) -> None:
    """Fill right-handed axes (3, 3) as rows: along the triangle's first side, in the triangle, across it."""
    x, y, z = axes[0], axes[1], axes[2]
    for k in range(3):
        x[k] = corners[1, k] - corners[0, k]
        y[k] = corners[2, k] - corners[0, k]
    cross(x, y, z)
    length, area = np.sqrt(dot(x, x)), np.sqrt(dot(z, z))
    for k in range(3):
        x[k] = x[k] / length
        z[k] = z[k] / area
    cross(z, x, y)


@njit(cache=True)
def four_apart(points: FloatArray) -> IntArray:
    """Return four points that are far apart: the farthest from the middle, then each the farthest from those chosen."""
    n = len(points)
    chosen = np.zeros(4, dtype=np.int64)
    nearest = np.full(n, np.inf)
    place = np.zeros(3)
    for i in range(n):
        for k in range(3):
            place[k] += points[i, k] / n
    for k in range(4):
        farthest = 0
        for i in range(n):
            away = 0.0
            for m in range(3):
                away += (points[i, m] - place[m]) ** 2
            # how far from the middle is for the first of them only
            nearest[i] = away if k < 2 else min(nearest[i], away)
            if nearest[i] > nearest[farthest]:
                farthest = i
        chosen[k] = farthest
        for m in range(3):
            place[m] = points[farthest, m]
    return chosen


@njit(cache=True)
def pose_between(surveyed: FloatArray, seen: FloatArray, R: FloatArray, t: FloatArray) -> bool:
    """Fill the rotation (3, 3) and translation (3,) from a surveyed triangle (3, 3), rows, to the one seen."""
    before, after = np.empty((3, 3)), np.empty((3, 3))
    triangle_axes(surveyed, before)
    triangle_axes(seen, after)
    for i in range(3):
        for k in range(3):
            R[i, k] = after[0, i] * before[0, k] + after[1, i] * before[1, k] + after[2, i] * before[2, k]
            if not np.isfinite(R[i, k]):
                return False
    for i in range(3):
        t[i] = 0.0
        for m in range(3):
            t[i] += (seen[m, i] - dot(R[i], surveyed[m])) / 3.0
    return True


@njit(cache=True)
def three_point_starts(points: FloatArray, rays: FloatArray, tangents: FloatArray, starts: FloatArray) -> int:
    """Fill ``starts`` (k, 8) with the best poses of all triples of four points, the best first; returns how many.

    The points span three triangles at least; each pose is evaluated by the weighted cost over all points.
    """
    most, found = len(starts), 0
    costs = np.full(most, np.inf)
    r, J = np.empty(2 * len(points) + 2), np.empty((2 * len(points) + 2, 8))
    four, nothing_known = four_apart(points), np.empty((0, 4))
    corners, seen, sides, area = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    q, R, t = np.empty(8), np.empty((3, 3)), np.empty(3)
    for left_out in range(4):
        i, j, k = four[(left_out + 1) % 4], four[(left_out + 2) % 4], four[(left_out + 3) % 4]
        for m in range(3):
            corners[0, m], corners[1, m], corners[2, m] = points[i, m], points[j, m], points[k, m]
            sides[0, m], sides[1, m] = points[j, m] - points[k, m], points[i, m] - points[k, m]
            sides[2, m] = points[i, m] - points[j, m]
        a2, b2, c2 = dot(sides[0], sides[0]), dot(sides[1], sides[1]), dot(sides[2], sides[2])
        cross(sides[1], sides[2], area)
        if dot(area, area) < 1e-12 * b2 * c2:
            continue
        ca, cb, cg = dot(rays[j], rays[k]), dot(rays[i], rays[k]), dot(rays[i], rays[j])
        depths = three_point_depths(a2, b2, c2, ca, cb, cg)
        for root in range(4):
            if depths[root, 0] <= 0.0:
                continue
            for m in range(3):
                seen[0, m], seen[1, m] = depths[root, 0] * rays[i, m], depths[root, 1] * rays[j, m]
                seen[2, m] = depths[root, 2] * rays[k, m]
            if not pose_between(corners, seen, R, t):
                continue
            dual_of(R, t, q)
            if not reprojection_residuals(q, points, rays, tangents, nothing_known, r, J):
                continue
            cost = 0.0
            for m in range(len(r)):
                cost += r[m] * r[m]
            if not cost < costs[most - 1]:
                continue
            found = min(found + 1, most)
            place = most - 1
            while place > 0 and cost < costs[place - 1]:
                costs[place] = costs[place - 1]
                for m in range(8):
                    starts[place, m] = starts[place - 1, m]
                place -= 1
            costs[place] = cost
            for m in range(8):
                starts[place, m] = q[m]
    return found
