"""Compiled arithmetic of the station model: projection with its Jacobian, and the ray of a pixel.

A station is one packed float64 array in the order of `groundstation.geometry.station_layout`.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.geometry.station_layout import (
    CAMERA_IN_HEAD,
    COS_LEAN,
    CX,
    CY,
    FX,
    FY,
    HEAD_FROM_CAMERA,
    LENS,
    LENS_END,
    PTU_POSITION,
    RUNWAY_FROM_BASE,
    SIN_LEAN,
)

MIN_DEPTH_M = 1e-3
_NEWTON_STEPS = 20
_NEWTON_TOLERANCE = 1e-14


class DistortedPoint(NamedTuple):
    """A distorted normalised point and its derivatives by the undistorted one."""

    x: float
    y: float
    x_by_x: float
    x_by_y: float
    y_by_x: float
    y_by_y: float


@njit(cache=True)
def distort(k: FloatArray, x: float, y: float) -> DistortedPoint:
    """Return a normalised point distorted by OpenCV's k1 k2 p1 p2 k3 model, and its derivatives.

    ``k`` is (6,): the five coefficients and the r² limit. Beyond the limit the radial factor is constant, and the
    tangential terms vanish smoothly with it: a polynomial fitted inside the image may fold back outside it and map a
    distant point into the picture.
    """
    k1, k2, p1, p2, k3, limit = k
    r2 = x * x + y * y
    inside = r2 <= limit
    q = r2 if inside else limit
    radial = 1.0 + q * (k1 + q * (k2 + q * k3))
    slope = (k1 + q * (2.0 * k2 + q * 3.0 * k3)) if inside else 0.0
    shrink = 1.0 if inside else limit / r2
    tx = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    ty = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    x_by_x = radial + 2.0 * x * x * slope + shrink * (2.0 * p1 * y + 6.0 * p2 * x)
    x_by_y = 2.0 * x * y * slope + shrink * (2.0 * p1 * x + 2.0 * p2 * y)
    y_by_x = 2.0 * x * y * slope + shrink * (2.0 * p1 * x + 2.0 * p2 * y)
    y_by_y = radial + 2.0 * y * y * slope + shrink * (6.0 * p1 * y + 2.0 * p2 * x)
    if not inside:
        ds = -shrink / r2 * 2.0
        x_by_x += tx * ds * x
        x_by_y += tx * ds * y
        y_by_x += ty * ds * x
        y_by_y += ty * ds * y
    return DistortedPoint(x * radial + shrink * tx, y * radial + shrink * ty, x_by_x, x_by_y, y_by_x, y_by_y)


@njit(cache=True)
def distort_rays(k: FloatArray, rays: FloatArray) -> FloatArray:
    """Return the distorted normalised points (n, 2) of camera rays (n, 3), whose z is positive."""
    out = np.empty((len(rays), 2))
    for i in range(len(rays)):
        point = distort(k, rays[i, 0] / rays[i, 2], rays[i, 1] / rays[i, 2])
        out[i, 0], out[i, 1] = point.x, point.y
    return out


@njit(cache=True)
def turned(s: FloatArray, first: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return R v, with the rotation R (3, 3) packed row-major from index ``first``."""
    return (
        s[first] * x + s[first + 1] * y + s[first + 2] * z,
        s[first + 3] * x + s[first + 4] * y + s[first + 5] * z,
        s[first + 6] * x + s[first + 7] * y + s[first + 8] * z,
    )


@njit(cache=True)
def turned_back(s: FloatArray, first: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return Rᵀ v, with the rotation R (3, 3) packed row-major from index ``first``."""
    return (
        s[first] * x + s[first + 3] * y + s[first + 6] * z,
        s[first + 1] * x + s[first + 4] * y + s[first + 7] * z,
        s[first + 2] * x + s[first + 5] * y + s[first + 8] * z,
    )


@njit(cache=True)
def project(
    s: FloatArray, point: FloatArray, pan: float, tilt: float, pixel: FloatArray, jacobian: FloatArray
) -> float:
    """Project a runway-frame point (3,) and return its depth in m (pixel and Jacobian valid if > 0).

    ``pixel`` (2,) is filled with u, v; ``jacobian`` (2, 5) with ∂(u, v)/∂(x, y, z, pan, tilt). The chain is
    X_camera = head_from_cameraᵀ (Rx(tilt)ᵀ Ry(lean)ᵀ Rz(pan)ᵀ runway_from_baseᵀ (X − ptu_position) − camera_in_head).
    """
    d0, d1, d2 = point[0] - s[PTU_POSITION], point[1] - s[PTU_POSITION + 1], point[2] - s[PTU_POSITION + 2]
    b0, b1, b2 = turned_back(s, RUNWAY_FROM_BASE, d0, d1, d2)
    cp, sp, ct, st = np.cos(pan), np.sin(pan), np.cos(tilt), np.sin(tilt)
    g0 = cp * b0 + sp * b1  # after the pan axis
    g1 = -sp * b0 + cp * b1
    cl, sl = s[COS_LEAN], s[SIN_LEAN]
    h0 = cl * g0 - sl * b2  # after the lean and the tilt axis: the head frame
    q2 = sl * g0 + cl * b2
    h1 = ct * g1 + st * q2
    h2 = -st * g1 + ct * q2
    a0, a1, a2 = h0 - s[CAMERA_IN_HEAD], h1 - s[CAMERA_IN_HEAD + 1], h2 - s[CAMERA_IN_HEAD + 2]
    c0, c1, c2 = turned_back(s, HEAD_FROM_CAMERA, a0, a1, a2)
    if c2 < MIN_DEPTH_M:
        return c2
    inverse = 1.0 / c2
    lens = distort(s[LENS:LENS_END], c0 * inverse, c1 * inverse)
    pixel[0] = s[FX] * lens.x + s[CX]
    pixel[1] = s[FY] * lens.y + s[CY]
    xn, yn = c0 * inverse, c1 * inverse
    for column in range(5):
        # derivative of the head-frame point
        if column < 3:
            e0 = s[RUNWAY_FROM_BASE + 3 * column]
            e1 = s[RUNWAY_FROM_BASE + 3 * column + 1]
            e2 = s[RUNWAY_FROM_BASE + 3 * column + 2]
            f0 = cp * e0 + sp * e1
            f1 = -sp * e0 + cp * e1
            r2 = sl * f0 + cl * e2
            v0, v1, v2 = cl * f0 - sl * e2, ct * f1 + st * r2, -st * f1 + ct * r2
        elif column == 3:
            r2 = sl * g1
            v0, v1, v2 = cl * g1, -ct * g0 + st * r2, st * g0 + ct * r2
        else:
            v0, v1, v2 = 0.0, h2, -h1
        w0, w1, w2 = turned_back(s, HEAD_FROM_CAMERA, v0, v1, v2)
        dx = (w0 - xn * w2) * inverse
        dy = (w1 - yn * w2) * inverse
        jacobian[0, column] = s[FX] * (lens.x_by_x * dx + lens.x_by_y * dy)
        jacobian[1, column] = s[FY] * (lens.y_by_x * dx + lens.y_by_y * dy)
    return c2


@njit(cache=True)
def undistort(k: FloatArray, xd: float, yd: float, out: FloatArray) -> bool:
    """Invert `distort` by Newton's method from (xd, yd); False if it does not converge.

    ``out`` (2,) is the undistorted normalised point.
    """
    x, y = xd, yd
    lens = distort(k, x, y)
    for _ in range(_NEWTON_STEPS):
        ex, ey = lens.x - xd, lens.y - yd
        determinant = lens.x_by_x * lens.y_by_y - lens.x_by_y * lens.y_by_x
        if determinant == 0.0:
            return False
        dx = (lens.y_by_y * ex - lens.x_by_y * ey) / determinant
        dy = (lens.x_by_x * ey - lens.y_by_x * ex) / determinant
        x -= dx
        y -= dy
        lens = distort(k, x, y)
        if dx * dx + dy * dy < _NEWTON_TOLERANCE**2 * (1.0 + x * x + y * y):
            break
    out[0], out[1] = x, y
    return bool(abs(lens.x - xd) + abs(lens.y - yd) < 1e-9 * (1.0 + abs(xd) + abs(yd)))


@njit(cache=True)
def ray(s: FloatArray, u: float, v: float, pan: float, tilt: float, origin: FloatArray, direction: FloatArray) -> bool:
    """Fill the runway-frame ray of a pixel: camera centre (3,) and unit direction (3,); False if the lens fails."""
    point = np.empty(2)
    good = undistort(s[LENS:LENS_END], (u - s[CX]) / s[FX], (v - s[CY]) / s[FY], point)
    cp, sp, ct, st = np.cos(pan), np.sin(pan), np.cos(tilt), np.sin(tilt)
    norm = np.sqrt(point[0] ** 2 + point[1] ** 2 + 1.0)
    c0, c1, c2 = point[0] / norm, point[1] / norm, 1.0 / norm
    for k in range(2):
        if k == 0:
            h0, h1, h2 = s[CAMERA_IN_HEAD], s[CAMERA_IN_HEAD + 1], s[CAMERA_IN_HEAD + 2]
        else:
            h0, h1, h2 = turned(s, HEAD_FROM_CAMERA, c0, c1, c2)
        g1 = ct * h1 - st * h2
        q2 = st * h1 + ct * h2
        g0 = s[COS_LEAN] * h0 + s[SIN_LEAN] * q2
        g2 = s[COS_LEAN] * q2 - s[SIN_LEAN] * h0
        b0 = cp * g0 - sp * g1
        b1 = sp * g0 + cp * g1
        v0, v1, v2 = turned(s, RUNWAY_FROM_BASE, b0, b1, g2)
        if k == 0:
            origin[0], origin[1] = v0 + s[PTU_POSITION], v1 + s[PTU_POSITION + 1]
            origin[2] = v2 + s[PTU_POSITION + 2]
        else:
            direction[0], direction[1], direction[2] = v0, v1, v2
    return good
