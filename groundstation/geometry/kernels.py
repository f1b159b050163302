"""Compiled arithmetic of the station model: projection with its Jacobian, and the ray of a pixel.

A station is one packed float64 array of `STATION_SIZE` numbers (see `groundstation.geometry.station`):
``runway_from_base`` (9, row-major), ``ptu_position`` (3), ``head_from_camera`` (9), ``camera_in_head`` (3),
fx, fy, cx, cy, k1, k2, p1, p2, k3, the largest r² at which the lens polynomial is used, and cosine and sine of the
angle by which the tilt axis leans out of the plane across the pan axis.
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray

STATION_SIZE = 36
MIN_DEPTH_M = 1e-3
_NEWTON_STEPS = 20
_NEWTON_TOLERANCE = 1e-14


@njit(cache=True)
def distort(k: FloatArray, x: float, y: float, out: FloatArray) -> None:
    """OpenCV's k1 k2 p1 p2 k3 model: out = x_d, y_d, ∂x_d/∂x, ∂x_d/∂y, ∂y_d/∂x, ∂y_d/∂y.

    ``k`` is (6,): the five coefficients and the r² limit. Beyond the limit the radial factor stays what it
    is there, and the tangential terms vanish smoothly with it: a polynomial fitted inside the image may turn
    back outside it and put a far-away point into the picture.
    """
    k1, k2, p1, p2, k3, limit = k[0], k[1], k[2], k[3], k[4], k[5]
    r2 = x * x + y * y
    inside = r2 <= limit
    q = r2 if inside else limit
    radial = 1.0 + q * (k1 + q * (k2 + q * k3))
    slope = (k1 + q * (2.0 * k2 + q * 3.0 * k3)) if inside else 0.0
    shrink = 1.0 if inside else limit / r2
    tx = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    ty = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    out[0] = x * radial + shrink * tx
    out[1] = y * radial + shrink * ty
    out[2] = radial + 2.0 * x * x * slope + shrink * (2.0 * p1 * y + 6.0 * p2 * x)
    out[3] = 2.0 * x * y * slope + shrink * (2.0 * p1 * x + 2.0 * p2 * y)
    out[4] = 2.0 * x * y * slope + shrink * (2.0 * p1 * x + 2.0 * p2 * y)
    out[5] = radial + 2.0 * y * y * slope + shrink * (6.0 * p1 * y + 2.0 * p2 * x)
    if not inside:
        ds = -shrink / r2 * 2.0
        out[2] += tx * ds * x
        out[3] += tx * ds * y
        out[4] += ty * ds * x
        out[5] += ty * ds * y


@njit(cache=True)
def project(
    s: FloatArray, point: FloatArray, pan: float, tilt: float, pixel: FloatArray, jacobian: FloatArray
) -> float:
    """Project a runway-frame point (3,) and return its depth in m (pixel and Jacobian valid if > 0).

    ``pixel`` (2,) is filled with u, v; ``jacobian`` (2, 5) with ∂(u, v)/∂(x, y, z, pan, tilt). The chain is
    X_camera = head_from_cameraᵀ (Rx(tilt)ᵀ Ry(lean)ᵀ Rz(pan)ᵀ runway_from_baseᵀ (X − ptu_position) − camera_in_head).
    """
    d0, d1, d2 = point[0] - s[9], point[1] - s[10], point[2] - s[11]
    b0 = s[0] * d0 + s[3] * d1 + s[6] * d2
    b1 = s[1] * d0 + s[4] * d1 + s[7] * d2
    b2 = s[2] * d0 + s[5] * d1 + s[8] * d2
    cp, sp, ct, st = np.cos(pan), np.sin(pan), np.cos(tilt), np.sin(tilt)
    g0 = cp * b0 + sp * b1  # after the pan axis
    g1 = -sp * b0 + cp * b1
    cl, sl = s[34], s[35]
    h0 = cl * g0 - sl * b2  # after the lean and the tilt axis: the head frame
    q2 = sl * g0 + cl * b2
    h1 = ct * g1 + st * q2
    h2 = -st * g1 + ct * q2
    a0, a1, a2 = h0 - s[21], h1 - s[22], h2 - s[23]
    c0 = s[12] * a0 + s[15] * a1 + s[18] * a2
    c1 = s[13] * a0 + s[16] * a1 + s[19] * a2
    c2 = s[14] * a0 + s[17] * a1 + s[20] * a2
    if c2 < MIN_DEPTH_M:
        return c2
    inverse = 1.0 / c2
    lens = np.empty(6)
    distort(s[28:34], c0 * inverse, c1 * inverse, lens)
    pixel[0] = s[24] * lens[0] + s[26]
    pixel[1] = s[25] * lens[1] + s[27]
    xn, yn = c0 * inverse, c1 * inverse
    for column in range(5):
        # derivative of the head-frame point
        if column < 3:
            e0 = s[3 * column]
            e1 = s[3 * column + 1]
            e2 = s[3 * column + 2]
            f0 = cp * e0 + sp * e1
            f1 = -sp * e0 + cp * e1
            r2 = sl * f0 + cl * e2
            v0, v1, v2 = cl * f0 - sl * e2, ct * f1 + st * r2, -st * f1 + ct * r2
        elif column == 3:
            r2 = sl * g1
            v0, v1, v2 = cl * g1, -ct * g0 + st * r2, st * g0 + ct * r2
        else:
            v0, v1, v2 = 0.0, h2, -h1
        w0 = s[12] * v0 + s[15] * v1 + s[18] * v2
        w1 = s[13] * v0 + s[16] * v1 + s[19] * v2
        w2 = s[14] * v0 + s[17] * v1 + s[20] * v2
        dx = (w0 - xn * w2) * inverse
        dy = (w1 - yn * w2) * inverse
        jacobian[0, column] = s[24] * (lens[2] * dx + lens[3] * dy)
        jacobian[1, column] = s[25] * (lens[4] * dx + lens[5] * dy)
    return c2


@njit(cache=True)
def undistort(k: FloatArray, xd: float, yd: float, out: FloatArray) -> bool:
    """Invert `distort` by Newton's method from (xd, yd); False if it does not converge.

    ``out`` (2,) is the undistorted normalised point.
    """
    x, y = xd, yd
    lens = np.empty(6)
    for _ in range(_NEWTON_STEPS):
        distort(k, x, y, lens)
        ex, ey = lens[0] - xd, lens[1] - yd
        determinant = lens[2] * lens[5] - lens[3] * lens[4]
        if determinant == 0.0:
            return False
        dx = (lens[5] * ex - lens[3] * ey) / determinant
        dy = (lens[2] * ey - lens[4] * ex) / determinant
        x -= dx
        y -= dy
        if dx * dx + dy * dy < _NEWTON_TOLERANCE**2 * (1.0 + x * x + y * y):
            break
    distort(k, x, y, lens)
    out[0], out[1] = x, y
    return bool(abs(lens[0] - xd) + abs(lens[1] - yd) < 1e-9 * (1.0 + abs(xd) + abs(yd)))


@njit(cache=True)
def ray(s: FloatArray, u: float, v: float, pan: float, tilt: float, origin: FloatArray, direction: FloatArray) -> bool:
    """Fill the runway-frame ray of a pixel: camera centre (3,) and unit direction (3,); False if the lens fails."""
    point = np.empty(2)
    good = undistort(s[28:34], (u - s[26]) / s[24], (v - s[27]) / s[25], point)
    cp, sp, ct, st = np.cos(pan), np.sin(pan), np.cos(tilt), np.sin(tilt)
    norm = np.sqrt(point[0] ** 2 + point[1] ** 2 + 1.0)
    c0, c1, c2 = point[0] / norm, point[1] / norm, 1.0 / norm
    for k in range(2):
        if k == 0:
            h0, h1, h2 = s[21], s[22], s[23]
        else:
            h0 = s[12] * c0 + s[13] * c1 + s[14] * c2
            h1 = s[15] * c0 + s[16] * c1 + s[17] * c2
            h2 = s[18] * c0 + s[19] * c1 + s[20] * c2
        g1 = ct * h1 - st * h2
        q2 = st * h1 + ct * h2
        g0 = s[34] * h0 + s[35] * q2
        g2 = s[34] * q2 - s[35] * h0
        b0 = cp * g0 - sp * g1
        b1 = sp * g0 + cp * g1
        for row in range(3):
            value = s[3 * row] * b0 + s[3 * row + 1] * b1 + s[3 * row + 2] * g2
            if k == 0:
                origin[row] = value + s[9 + row]
            else:
                direction[row] = value
    return good
