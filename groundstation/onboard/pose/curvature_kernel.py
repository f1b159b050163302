"""Compiled second-order part of the pose's covariance.

A far runway says next to everything by a few numbers that are known very well (where it stands in the picture) and
others that are known badly (how far, how flat). In metres and radians the former are bent by the latter: the cloud of
estimates is a curved sheet, thicker than its tangent. To second order the estimate's error in units of sigma is

    ξ = Jᵀn − ½ Jᵀ h(Jᵀn, Jᵀn),  n ~ N(0, 1),

with J the residuals' Jacobian by ξ and h their second derivative, so that ½ Σ_kl c_kl c_klᵀ, c_kl = Jᵀ h_kl, is added
to the identity (variance of a quadratic form). Not in the paper.
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.onboard.pose.view_kernel import pose_of

_STEP = 0.1


@njit(cache=True)
def _residuals(
    points: FloatArray,
    rays: FloatArray,
    tangents: FloatArray,
    R: FloatArray,
    c: FloatArray,
    d: FloatArray,
    out: FloatArray,
) -> None:
    """Fill corner residuals (2n,) in sigmas of the pose (R, c), moved by d (6,) as in `information_of`.

    R (3, 3) is camera_from_runway, c (3,) the camera; R_true = exp([δθ]×) R of runway_from_camera.
    """
    angle = np.sqrt(d[3] ** 2 + d[4] ** 2 + d[5] ** 2)
    sine = 1.0 if angle < 1e-9 else np.sin(angle) / angle
    versine = 0.5 if angle < 1e-9 else (1.0 - np.cos(angle)) / (angle * angle)
    a, b, x = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(points)):
        for k in range(3):
            a[k] = points[i, k] - c[k] - d[k]
        # exp([−δθ]×) a = a − sine δθ × a + versine δθ × (δθ × a)
        w0 = d[4] * a[2] - d[5] * a[1]
        w1 = d[5] * a[0] - d[3] * a[2]
        w2 = d[3] * a[1] - d[4] * a[0]
        b[0] = a[0] - sine * w0 + versine * (d[4] * w2 - d[5] * w1)
        b[1] = a[1] - sine * w1 + versine * (d[5] * w0 - d[3] * w2)
        b[2] = a[2] - sine * w2 + versine * (d[3] * w1 - d[4] * w0)
        for k in range(3):
            x[k] = R[k, 0] * b[0] + R[k, 1] * b[1] + R[k, 2] * b[2]
        depth = rays[i, 0] * x[0] + rays[i, 1] * x[1] + rays[i, 2] * x[2]
        for part in range(2):
            m = tangents[i, part]
            out[2 * i + part] = (m[0] * x[0] + m[1] * x[1] + m[2] * x[2]) / depth


@njit(cache=True)
def second_order(
    points: FloatArray, rays: FloatArray, tangents: FloatArray, q: FloatArray, root: FloatArray
) -> FloatArray:
    """Return ½ Σ_kl c_kl c_klᵀ (6, 6), in units of ``root`` (6, 6), the first-order covariance's Cholesky factor.

    Derivatives are central differences over a tenth of a sigma.
    """
    R, t = np.empty((3, 3)), np.empty(3)
    pose_of(q, R, t)
    c = -R.T @ t
    count = 2 * len(points)
    middle, bent = np.empty(count), np.empty((6, 6, count))
    ahead, back, J = np.empty((6, count)), np.empty((6, count)), np.empty((count, 6))
    ab, ba, aa, bb = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    steps = _STEP * root
    _residuals(points, rays, tangents, R, c, np.zeros(6), middle)
    for k in range(6):
        _residuals(points, rays, tangents, R, c, steps[:, k].copy(), ahead[k])
        _residuals(points, rays, tangents, R, c, -steps[:, k], back[k])
        J[:, k] = (ahead[k] - back[k]) / (2.0 * _STEP)
        bent[k, k] = (ahead[k] + back[k] - 2.0 * middle) / _STEP**2
        for m in range(k):
            _residuals(points, rays, tangents, R, c, steps[:, k] + steps[:, m], aa)
            _residuals(points, rays, tangents, R, c, -steps[:, k] - steps[:, m], bb)
            _residuals(points, rays, tangents, R, c, steps[:, k] - steps[:, m], ab)
            _residuals(points, rays, tangents, R, c, steps[:, m] - steps[:, k], ba)
            bent[k, m] = (aa + bb - ab - ba) / (4.0 * _STEP**2)
            bent[m, k] = bent[k, m]
    out = np.zeros((6, 6))
    for k in range(6):
        for m in range(6):
            pull = J.T @ bent[k, m].copy()
            out += 0.5 * np.outer(pull, pull)
    return out
