"""Compiled arithmetic: how a projected pixel moves with a station's calibration (docs/derivation.md, section 10).

The order of the columns is that of `groundstation.geometry.calibration.CALIBRATION_PARAMETERS`. All of them but
the lens's follow from ∂pixel/∂point: an error of the calibration acts as a shift of the point in some frame.
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.geometry.kernels import MIN_DEPTH_M, project, turned_back
from groundstation.geometry.station_layout import (
    CAMERA_IN_HEAD,
    COS_LEAN,
    CX,
    CY,
    FX,
    FY,
    HEAD_FROM_CAMERA,
    PTU_POSITION,
    RADIUS_LIMIT,
    RUNWAY_FROM_BASE,
    SIN_LEAN,
)

CALIBRATION_SIZE = 21


@njit(cache=True)
def project_calibration(
    s: FloatArray,
    point: FloatArray,
    pan: float,
    tilt: float,
    pixel: FloatArray,
    jacobian: FloatArray,
    calibration: FloatArray,
) -> float:
    """Project a runway-frame point (3,) and return its depth in m (the arrays are valid if > `MIN_DEPTH_M`).

    ``s`` is the packed station; ``pixel`` (2,) and ``jacobian`` (2, 5) are filled as by `kernels.project`,
    ``calibration`` (2, 21) with ∂(u, v)/∂calibration in px per rad, per m, per px and per unit.
    """
    depth = project(s, point, pan, tilt, pixel, jacobian)
    if depth < MIN_DEPTH_M:
        return depth
    d = np.empty(3)
    for k in range(3):
        d[k] = point[k] - s[PTU_POSITION + k]
    cp, sp, ct, st = np.cos(pan), np.sin(pan), np.cos(tilt), np.sin(tilt)
    # columns of runway_from_head = runway_from_base · Rz(pan) · Ry(lean) · Rx(tilt)
    cl, sl = s[COS_LEAN], s[SIN_LEAN]
    runway_from_head = np.empty((3, 3))
    for r in range(3):
        r0, r1, r2 = s[RUNWAY_FROM_BASE + 3 * r], s[RUNWAY_FROM_BASE + 3 * r + 1], s[RUNWAY_FROM_BASE + 3 * r + 2]
        forward = cp * r1 - sp * r0
        right = cp * r0 + sp * r1
        up = sl * right + cl * r2
        runway_from_head[r, 0] = cl * right - sl * r2
        runway_from_head[r, 1] = ct * forward + st * up
        runway_from_head[r, 2] = ct * up - st * forward
    arm = np.empty(3)  # from the camera to the point, head frame
    for k in range(3):
        arm[k] = -s[CAMERA_IN_HEAD + k]
        for r in range(3):
            arm[k] += runway_from_head[r, k] * d[r]
    by_head = np.empty(3)
    for row in range(2):
        by_point = jacobian[row, :3]
        for k in range(3):
            by_head[k] = 0.0
            for r in range(3):
                by_head[k] += by_point[r] * runway_from_head[r, k]
        # rotating a frame by θ moves its content by −θ × arm; ∂/∂θ of g · (arm × θ) is g × arm
        _cross(by_point, d, calibration[row, 0:3])
        _cross(by_head, arm, calibration[row, 6:9])
        for k in range(3):
            calibration[row, 3 + k] = -by_point[k]
            calibration[row, 9 + k] = -by_head[k]
    _by_lens(s, (pixel[0] - s[CX]) / s[FX], (pixel[1] - s[CY]) / s[FY], arm, calibration)
    return depth


@njit(cache=True)
def _cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _by_lens(s: FloatArray, xd: float, yd: float, arm: FloatArray, calibration: FloatArray) -> None:
    """Fill the columns of focal length, principal point and distortion; ``xd``, ``yd`` are the distorted point."""
    calibration[:, 12:21] = 0.0
    calibration[0, 12], calibration[1, 13] = xd, yd
    calibration[0, 14], calibration[1, 15] = 1.0, 1.0
    c0, c1, depth = turned_back(s, HEAD_FROM_CAMERA, arm[0], arm[1], arm[2])
    x, y = c0 / depth, c1 / depth
    r2 = x * x + y * y
    limit = s[RADIUS_LIMIT]
    # as in `kernels.distort`: beyond the limit the radial factor is held and the tangential terms fade
    q = r2 if r2 <= limit else limit
    shrink = 1.0 if r2 <= limit else limit / r2
    fx, fy = s[FX], s[FY]
    radial = q
    for column in (16, 17, 20):  # k1, k2, k3
        calibration[0, column], calibration[1, column] = fx * x * radial, fy * y * radial
        radial *= q
    calibration[0, 18], calibration[1, 18] = fx * shrink * 2.0 * x * y, fy * shrink * (r2 + 2.0 * y * y)
    calibration[0, 19], calibration[1, 19] = fx * shrink * (r2 + 2.0 * x * x), fy * shrink * 2.0 * x * y


@njit(cache=True)
def project_calibration_many(
    s: FloatArray,
    points: FloatArray,
    angles: FloatArray,
    pixels: FloatArray,
    jacobians: FloatArray,
    calibrations: FloatArray,
    depths: FloatArray,
) -> None:
    """Do `project_calibration` for points (n, 3) at pan and tilt (n, 2) into arrays of n; ``depths`` (n,) in m."""
    for k in range(len(points)):
        depths[k] = project_calibration(
            s, points[k], angles[k, 0], angles[k, 1], pixels[k], jacobians[k], calibrations[k]
        )
