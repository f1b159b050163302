"""Compiled arithmetic around the solver: rays and their tangents from pixels, conversions, reprojection, covariance.

Arrays are filled by loops: a slice that is assigned to, or an outer product, takes numba seconds to compile.

A lens is packed as (10,): fx, fy, cx, cy, k1, k2, p1, p2, k3, the r² limit of `groundstation.geometry.kernels.distort`.
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.geometry.kernels import distort, undistort

_FX, _FY, _CX, _CY, _DISTORTION = 0, 1, 2, 3, 4


@njit(cache=True)
def look(lens: FloatArray, pixels: FloatArray, covariances: FloatArray, rays: FloatArray, tangents: FloatArray) -> bool:
    """Fill unit rays (n, 3) of pixels (n, 2) and whitened tangents (n, 2, 3); False where the lens has no inverse.

    The tangent plane's coordinates of a point X are B X / (u · X) with B (2, 3) across u; the tangents are L⁻¹ B, with
    L Lᵀ the pixel's covariance (n, 2, 2) brought there.
    """
    point = np.empty(2)
    B = np.empty((2, 3))
    for i in range(len(pixels)):
        x, y = (pixels[i, 0] - lens[_CX]) / lens[_FX], (pixels[i, 1] - lens[_CY]) / lens[_FY]
        if not undistort(lens[_DISTORTION:], x, y, point):
            return False
        d = distort(lens[_DISTORTION:], point[0], point[1])
        norm = np.sqrt(point[0] ** 2 + point[1] ** 2 + 1.0)
        u0, u1, u2 = point[0] / norm, point[1] / norm, 1.0 / norm
        rays[i, 0], rays[i, 1], rays[i, 2] = u0, u1, u2
        # across u: first in the plane of x and z, u is never along y in a picture
        length = np.sqrt(u0 * u0 + u2 * u2)
        B[0, 0], B[0, 1], B[0, 2] = u2 / length, 0.0, -u0 / length
        B[1, 0] = u1 * B[0, 2] - u2 * B[0, 1]
        B[1, 1] = u2 * B[0, 0] - u0 * B[0, 2]
        B[1, 2] = u0 * B[0, 1] - u1 * B[0, 0]
        # ∂(normalised)/∂(pixel), then ∂(tangent)/∂(normalised) = B / norm
        determinant = d.x_by_x * d.y_by_y - d.x_by_y * d.y_by_x
        nx = np.array([d.y_by_y / lens[_FX], -d.y_by_x / lens[_FX]]) / determinant
        ny = np.array([-d.x_by_y / lens[_FY], d.x_by_x / lens[_FY]]) / determinant
        G = np.empty((2, 2))
        for k in range(2):
            G[k, 0] = (B[k, 0] * nx[0] + B[k, 1] * nx[1]) / norm
            G[k, 1] = (B[k, 0] * ny[0] + B[k, 1] * ny[1]) / norm
        S = G @ covariances[i] @ G.T
        l00 = np.sqrt(S[0, 0])
        l10 = S[1, 0] / l00
        l11 = np.sqrt(S[1, 1] - l10 * l10)
        for k in range(3):
            tangents[i, 0, k] = B[0, k] / l00
            tangents[i, 1, k] = (B[1, k] - l10 * tangents[i, 0, k]) / l11
    return True


@njit(cache=True)
def quaternion_of(m: FloatArray) -> FloatArray:
    """Return the unit quaternion (4,), w first, of a rotation matrix; the largest component is found first."""
    squares = np.array(
        [
            1 + m[0, 0] + m[1, 1] + m[2, 2],
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
        ]
    )
    a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    e, f, g = m[1, 0] + m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2]
    k = int(np.argmax(squares))
    if k == 0:
        q = np.array([squares[0], a, b, c])
    elif k == 1:
        q = np.array([a, squares[1], e, f])
    elif k == 2:
        q = np.array([b, e, squares[2], g])
    else:
        q = np.array([c, f, g, squares[3]])
    return q / np.sqrt((q * q).sum())


@njit(cache=True)
def matrix_of(q: FloatArray) -> FloatArray:
    """Return the rotation matrix of a quaternion of any length, w first."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
    )


@njit(cache=True)
def dual_of(R: FloatArray, t: FloatArray, q: FloatArray) -> None:
    """Fill the unit dual quaternion (8,) of x ↦ R x + t."""
    r = quaternion_of(R)
    for k in range(4):
        q[k] = r[k]
    q[4] = -0.5 * (t[0] * r[1] + t[1] * r[2] + t[2] * r[3])
    q[5] = 0.5 * (t[0] * r[0] + t[1] * r[3] - t[2] * r[2])
    q[6] = 0.5 * (t[1] * r[0] + t[2] * r[1] - t[0] * r[3])
    q[7] = 0.5 * (t[2] * r[0] + t[0] * r[2] - t[1] * r[1])


@njit(cache=True)
def pose_of(q: FloatArray, R: FloatArray, t: FloatArray) -> None:
    """Fill R (3, 3) and t (3,) of a dual quaternion of any length."""
    turn = matrix_of(q)
    for i in range(3):
        for k in range(3):
            R[i, k] = turn[i, k]
    s = 2.0 / (q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    t[0] = s * (-q[4] * q[1] + q[0] * q[5] + q[2] * q[7] - q[3] * q[6])
    t[1] = s * (-q[4] * q[2] + q[0] * q[6] + q[3] * q[5] - q[1] * q[7])
    t[2] = s * (-q[4] * q[3] + q[0] * q[7] + q[1] * q[6] - q[2] * q[5])


@njit(cache=True)
def plane_normal(points: FloatArray) -> FloatArray:
    """Return the unit normal (3,) of the plane nearest to the points, on either side."""
    centred = points - points.sum(axis=0) / len(points)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    return vectors[:, 0].copy()


@njit(cache=True)
def half_turn(axis: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) by 180° about a unit vector (3,), 2 a aᵀ − I."""
    R = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            R[i, k] = 2.0 * axis[i] * axis[k] - (1.0 if i == k else 0.0)
    return R


@njit(cache=True)
def turned_to_front(points: FloatArray, rays: FloatArray, q: FloatArray) -> None:
    """If most points are behind the camera, replace the pose by the equivalent one in front of their plane.

    For points of a plane with normal n, (R Rot(n, 180°), −t) about their middle has every point at −X.
    """
    R, t = np.empty((3, 3)), np.empty(3)
    pose_of(q, R, t)
    facing = 0.0
    for i in range(len(points)):
        facing += np.sign((rays[i] * (R @ points[i] + t)).sum())
    if facing >= 0:
        return
    centre = points.sum(axis=0) / len(points)
    middle = -(R @ centre + t)
    R = R @ half_turn(plane_normal(points))
    dual_of(R, middle - R @ centre, q)


@njit(cache=True)
def mirrored_start(points: FloatArray, q: FloatArray, out: FloatArray) -> None:
    """Fill the other pose with a similar picture of a far plane: its normal mirrored about the line of sight."""
    R, t = np.empty((3, 3)), np.empty(3)
    pose_of(q, R, t)
    centre = points.sum(axis=0) / len(points)
    middle = R @ centre + t
    sight = middle / np.sqrt((middle * middle).sum())
    # half a turn about the sight carries n to its mirror image and turns the plane in itself; undo the latter
    R = half_turn(sight) @ half_turn(R @ plane_normal(points)) @ R
    dual_of(R, middle - R @ centre, out)


@njit(cache=True)
def reprojection_rms(lens: FloatArray, points: FloatArray, pixels: FloatArray, q: FloatArray) -> float:
    """Return the root mean square distance in px between corners and the projected points; inf if one is behind."""
    R, t = np.empty((3, 3)), np.empty(3)
    pose_of(q, R, t)
    total = 0.0
    for i in range(len(points)):
        x = R @ points[i] + t
        if x[2] <= 0.0:
            return np.inf
        d = distort(lens[_DISTORTION:], x[0] / x[2], x[1] / x[2])
        total += (lens[_FX] * d.x + lens[_CX] - pixels[i, 0]) ** 2 + (lens[_FY] * d.y + lens[_CY] - pixels[i, 1]) ** 2
    return np.sqrt(total / len(points))


@njit(cache=True)
def information_of(points: FloatArray, rays: FloatArray, tangents: FloatArray, q: FloatArray) -> FloatArray:
    """Return the information (6, 6) on the camera's position and attitude δθ, both in the runway frame.

    R_true = exp([δθ]×) R with R = runway_from_camera; X = Rᵀ (P − c), so δX = −Rᵀ δc + Rᵀ [P − c]× δθ.
    """
    R, t = np.empty((3, 3)), np.empty(3)
    pose_of(q, R, t)
    centre = -R.T @ t
    J = np.empty((2 * len(points), 6))
    D = np.empty((3, 6))
    for i in range(len(points)):
        a = points[i] - centre
        x = R @ a
        for k in range(3):
            for m in range(3):
                D[k, m] = -R[k, m]
            D[k, 3] = R[k, 1] * a[2] - R[k, 2] * a[1]
            D[k, 4] = R[k, 2] * a[0] - R[k, 0] * a[2]
            D[k, 5] = R[k, 0] * a[1] - R[k, 1] * a[0]
        depth = (rays[i] * x).sum()
        for part in range(2):
            m = tangents[i, part]
            e = (m * x).sum() / depth
            across = m - e * rays[i]
            for k in range(6):
                J[2 * i + part, k] = (across[0] * D[0, k] + across[1] * D[1, k] + across[2] * D[2, k]) / depth
    return J.T @ J
