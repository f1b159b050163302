"""Compiled start of the solver: the poses that three of the points allow exactly, judged by all of them.

Grunert's quartic as in Haralick, Lee, Ottenberg and Nölle, "Review and analysis of solutions of the three point
perspective pose estimation problem", 1994.
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, IntArray
from groundstation.onboard.pose.kernel import weighted_rows
from groundstation.onboard.pose.view_kernel import dual_of

_NO_ROWS = np.zeros((0, 4))


@njit(cache=True)
def three_point_depths(a2: float, b2: float, c2: float, ca: float, cb: float, cg: float) -> FloatArray:
    """Return distances (4, 3) along three rays; a², b², c² opposite points 1, 2, 3, and the cosines between rays.

    Roots that noise has made complex stand by their real part: it is a start, not a result. Rows of zeros are none.
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
            # a complex pair has no u of its own; the side c tells it from v: u² − 2 u cos γ + 1 = c² (1 + v² …) / b²
            u = cg
        first = np.sqrt(b2 / square)
        depths[i] = np.array([first, u * first, v * first])
    return depths


@njit(cache=True)
def triangle_axes(first: FloatArray, second: FloatArray, third: FloatArray) -> FloatArray:
    """Return right-handed axes (3, 3) as columns: along the first side, in the triangle, across it."""
    x = second - first
    x = x / np.sqrt((x * x).sum())
    z = np.cross(x, third - first)
    z = z / np.sqrt((z * z).sum())
    axes = np.empty((3, 3))
    axes[:, 0], axes[:, 1], axes[:, 2] = x, np.cross(z, x), z
    return axes


@njit(cache=True)
def four_apart(points: FloatArray) -> IntArray:
    """Return four points that lie far apart: the farthest from the middle, then each the farthest from those taken."""
    n = len(points)
    chosen = np.zeros(4, dtype=np.int64)
    nearest = np.empty(n)
    middle = points.sum(axis=0) / n
    for i in range(n):
        nearest[i] = ((points[i] - middle) ** 2).sum()
    for k in range(4):
        chosen[k] = int(np.argmax(nearest))
        for i in range(n):
            away = ((points[i] - points[chosen[k]]) ** 2).sum()
            nearest[i] = away if k == 0 else min(nearest[i], away)
    return chosen


@njit(cache=True)
def three_point_starts(points: FloatArray, rays: FloatArray, tangents: FloatArray, starts: FloatArray) -> int:
    """Fill ``starts`` (k, 8) with the best poses of all triples of four points, the best first; returns how many.

    The points span three triangles at least; each pose is judged by the weighted cost over all points.
    """
    most = len(starts)
    costs = np.full(most, np.inf)
    r, J = np.empty(2 * len(points) + 2), np.empty((2 * len(points) + 2, 8))
    four = four_apart(points)
    q = np.empty(8)
    for left_out in range(4):
        i, j, k = four[(left_out + 1) % 4], four[(left_out + 2) % 4], four[(left_out + 3) % 4]
        a, b, c = points[j] - points[k], points[i] - points[k], points[i] - points[j]
        area = np.cross(b, c)
        a2, b2, c2 = (a * a).sum(), (b * b).sum(), (c * c).sum()
        if (area * area).sum() < 1e-12 * b2 * c2:
            continue
        ca, cb, cg = (rays[j] * rays[k]).sum(), (rays[i] * rays[k]).sum(), (rays[i] * rays[j]).sum()
        depths = three_point_depths(a2, b2, c2, ca, cb, cg)
        surveyed = triangle_axes(points[i], points[j], points[k])
        for root in range(4):
            s = depths[root]
            if s[0] <= 0.0:
                continue
            seen_i, seen_j, seen_k = s[0] * rays[i], s[1] * rays[j], s[2] * rays[k]
            R = triangle_axes(seen_i, seen_j, seen_k) @ surveyed.T
            if not np.isfinite(R).all():
                continue
            t = (seen_i + seen_j + seen_k - R @ (points[i] + points[j] + points[k])) / 3.0
            dual_of(R, t, q)
            if not weighted_rows(q, points, rays, tangents, _NO_ROWS, r, J):
                continue
            cost = (r * r).sum()
            place = most
            while place > 0 and cost < costs[place - 1]:
                place -= 1
            if place < most:
                for m in range(most - 1, place, -1):
                    costs[m] = costs[m - 1]
                    starts[m] = starts[m - 1]
                costs[place] = cost
                starts[place] = q
    return int(np.isfinite(costs).sum())
