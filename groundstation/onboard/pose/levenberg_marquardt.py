"""Compiled Levenberg-Marquardt over the eight numbers of a dual quaternion, for the two costs of the runway's pose.

The unknown is ``camera_from_runway`` (8,), lengths in a unit of the runway's own size. scipy's solver takes several
ms for these eight numbers; this one is held against it in tests/onboard/pose/test_solver.py.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, IntArray

COPLANARITY, REPROJECTION = 0, 1
# cost 100 (q_rᵀq_r − 1)² + 100 (q_rᵀq_d)², as in the paper
UNIT_ROOT_WEIGHT = 10.0
_FIRST_DAMPING = 1e-4
_MOST_DAMPING = 1e12
_LEAST_DEPTH = 1e-9


@njit(cache=True)
def move_point(q: FloatArray, p: FloatArray, share: float, x: FloatArray, jacobian: FloatArray) -> None:
    """Fill x (3,) = vec(q_r p q_r* + share · 2 q_d q_r*) and its derivative (3, 8); share 0 turns a direction only."""
    w, a, b, c = q[0], q[1], q[2], q[3]
    d0, d1, d2, d3 = share * q[4], share * q[5], share * q[6], share * q[7]
    px, py, pz = p[0], p[1], p[2]
    dot = a * px + b * py + c * pz
    sx, sy, sz = b * pz - c * py, c * px - a * pz, a * py - b * px
    less = w * w - a * a - b * b - c * c
    x[0] = less * px + 2 * (dot * a + w * sx - d0 * a + w * d1 - d2 * c + d3 * b)
    x[1] = less * py + 2 * (dot * b + w * sy - d0 * b + w * d2 - d3 * a + d1 * c)
    x[2] = less * pz + 2 * (dot * c + w * sz - d0 * c + w * d3 - d1 * b + d2 * a)
    j = jacobian
    j[0, 0] = 2 * (w * px + sx + d1)
    j[1, 0] = 2 * (w * py + sy + d2)
    j[2, 0] = 2 * (w * pz + sz + d3)
    # ∂/∂v of the rotation: −2 p vᵀ + 2 v pᵀ + 2 (v·p) I − 2 w [p]×, and of 2 q_d q_r*: −2 d0 I − 2 [d]×
    j[0, 1] = 2 * (dot - d0)
    j[1, 1] = 2 * (b * px - py * a - w * pz - d3)
    j[2, 1] = 2 * (c * px - pz * a + w * py + d2)
    j[0, 2] = 2 * (a * py - px * b + w * pz + d3)
    j[1, 2] = 2 * (dot - d0)
    j[2, 2] = 2 * (c * py - pz * b - w * px - d1)
    j[0, 3] = 2 * (a * pz - px * c - w * py - d2)
    j[1, 3] = 2 * (b * pz - py * c + w * px + d1)
    j[2, 3] = 2 * (dot - d0)
    s = 2 * share
    j[0, 4], j[1, 4], j[2, 4] = -s * a, -s * b, -s * c
    j[0, 5], j[1, 5], j[2, 5] = s * w, s * c, -s * b
    j[0, 6], j[1, 6], j[2, 6] = -s * c, s * w, s * a
    j[0, 7], j[1, 7], j[2, 7] = s * b, -s * a, s * w


@njit(cache=True)
def unit_rows(q: FloatArray, r: FloatArray, J: FloatArray, row: int) -> None:
    """Fill the two unit constraints and their derivative."""
    r[row] = UNIT_ROOT_WEIGHT * (q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2 - 1.0)
    r[row + 1] = UNIT_ROOT_WEIGHT * (q[0] * q[4] + q[1] * q[5] + q[2] * q[6] + q[3] * q[7])
    for k in range(4):
        J[row, k] = UNIT_ROOT_WEIGHT * 2.0 * q[k]
        J[row, 4 + k] = 0.0
        J[row + 1, k] = UNIT_ROOT_WEIGHT * q[4 + k]
        J[row + 1, 4 + k] = UNIT_ROOT_WEIGHT * q[k]


@njit(cache=True)
def coplanarity_residuals(
    q: FloatArray, points: FloatArray, normals: FloatArray, pairs: IntArray, metres: float, r: FloatArray, J: FloatArray
) -> bool:
    """Fill the paper's residuals: for each pair (i, j) n·R d, and n·(R p_j + t) in m; then the unit constraints."""
    x, j = np.empty(3), np.empty((3, 8))
    d = np.empty(3)
    row = 0
    for m in range(len(pairs)):
        for part in range(2):
            if part == 0:
                for k in range(3):
                    d[k] = points[pairs[m, 1], k] - points[pairs[m, 0], k]
                length = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
                move_point(q, d / length, 0.0, x, j)
                weight = 1.0
            else:
                move_point(q, points[pairs[m, 1]], 1.0, x, j)
                weight = metres
            r[row] = weight * (normals[m, 0] * x[0] + normals[m, 1] * x[1] + normals[m, 2] * x[2])
            for k in range(8):
                J[row, k] = weight * (normals[m, 0] * j[0, k] + normals[m, 1] * j[1, k] + normals[m, 2] * j[2, k])
            row += 1
    unit_rows(q, r, J, row)
    return True


@njit(cache=True)
def reprojection_residuals(
    q: FloatArray,
    points: FloatArray,
    rays: FloatArray,
    tangents: FloatArray,
    attitude: FloatArray,
    r: FloatArray,
    J: FloatArray,
) -> bool:
    """Fill the weighted residuals; False where a corner is behind the camera.

    ``tangents`` (n, 2, 3) span, for each ray u, the normals n_ij that contain it, scaled so that
    n · X / (u · X) is in sigmas of the corner; ``attitude`` (k, 4) is the prior of q_r as rows times q_r.
    """
    x, j = np.empty(3), np.empty((3, 8))
    row = 0
    for i in range(len(points)):
        move_point(q, points[i], 1.0, x, j)
        depth = rays[i, 0] * x[0] + rays[i, 1] * x[1] + rays[i, 2] * x[2]
        if depth < _LEAST_DEPTH:
            return False
        for part in range(2):
            m = tangents[i, part]
            e = (m[0] * x[0] + m[1] * x[1] + m[2] * x[2]) / depth
            r[row] = e
            for k in range(8):
                along = rays[i, 0] * j[0, k] + rays[i, 1] * j[1, k] + rays[i, 2] * j[2, k]
                J[row, k] = (m[0] * j[0, k] + m[1] * j[1, k] + m[2] * j[2, k] - e * along) / depth
            row += 1
    for i in range(len(attitude)):
        r[row] = 0.0
        for k in range(4):
            r[row] += attitude[i, k] * q[k]
            J[row, k] = attitude[i, k]
            J[row, 4 + k] = 0.0
        row += 1
    unit_rows(q, r, J, row)
    return True


class PoseCost(NamedTuple):
    """One of the two costs, ``kind``, with its data.

    ``points`` (n, 3), ``rays`` (n, 3), ``tangents`` (n, 2, 3); ``attitude`` (k, 4) of the reprojection cost alone;
    ``normals`` (m, 3) of ``pairs`` (m, 2) of points, and ``metres`` in a unit of length, of the coplanarity cost.
    """

    kind: int
    points: FloatArray
    rays: FloatArray
    tangents: FloatArray
    attitude: FloatArray
    normals: FloatArray
    pairs: IntArray
    metres: float


@njit(cache=True)
def residuals(cost: PoseCost, q: FloatArray, r: FloatArray, J: FloatArray) -> bool:
    """Fill residuals and Jacobian of a cost; false where a point is not in front of the camera."""
    if cost.kind == COPLANARITY:
        return coplanarity_residuals(q, cost.points, cost.normals, cost.pairs, cost.metres, r, J)
    return reprojection_residuals(q, cost.points, cost.rays, cost.tangents, cost.attitude, r, J)


@njit(cache=True)
def levenberg_marquardt(problem: PoseCost, q: FloatArray, most: int, tolerance: float) -> tuple[float, int, bool]:
    """Minimise from ``q`` (8,) in place; returns the sum of squares, the steps tried, and whether it converged.

    The damping follows Marquardt's scaling with the largest diagonal seen, so units do not matter.
    """
    count = 2 * len(problem.points) + len(problem.attitude) + 2
    if problem.kind == COPLANARITY:
        count = 2 * len(problem.pairs) + 2
    r, J = np.empty(count), np.empty((count, 8))
    r_new, J_new = np.empty(count), np.empty((count, 8))
    if not residuals(problem, q, r, J):
        return np.inf, 0, False
    cost = (r * r).sum()
    damping = _FIRST_DAMPING
    largest = np.zeros(8)
    A = np.empty((8, 8))
    for step in range(most):
        N = J.T @ J
        g = J.T @ r
        for k in range(8):
            largest[k] = max(largest[k], N[k, k])
        floor = 1e-12 * largest.max()
        for k in range(8):
            for m in range(8):
                A[k, m] = N[k, m]
            A[k, k] += damping * max(largest[k], floor)
        move = np.linalg.solve(A, g)
        q_new = q - move
        good = residuals(problem, q_new, r_new, J_new)
        cost_new = (r_new * r_new).sum() if good else np.inf
        small = np.sqrt((move * move).sum()) <= tolerance * (tolerance + np.sqrt((q * q).sum()))
        if cost_new <= cost:
            for k in range(8):
                q[k] = q_new[k]
            small = small or cost - cost_new <= tolerance * tolerance * cost
            cost = cost_new
            r, r_new = r_new, r
            J, J_new = J_new, J
            damping = max(damping * 0.1, 1e-12)
        else:
            damping *= 10.0
        if small:
            return cost, step + 1, True
        if damping > _MOST_DAMPING:
            return cost, step + 1, False
    return cost, most, False
