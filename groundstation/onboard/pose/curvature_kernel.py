"""Compiled second-order part of the pose's covariance.

The information of a far runway is in a few accurately known numbers (its position in the picture) and
others that are poorly known (distance, flatness). In metres and radians the former are bent by the latter: the cloud of
estimates is a curved sheet, thicker than its tangent. To second order the estimate's error in units of sigma is

    ξ = Jᵀn − ½ Jᵀ h(Jᵀn, Jᵀn),  n ~ N(0, 1),

with J the residuals' Jacobian by ξ and h their second derivative, so that ½ Σ_kl c_kl c_klᵀ, c_kl = Jᵀ h_kl, is added
to the identity (variance of a quadratic form). Not in the paper.
"""

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.onboard.pose.camera_kernel import pose_of

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
    shift, turn = d[:3], d[3:]
    angle = np.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    sine = 1.0 if angle < 1e-9 else np.sin(angle) / angle
    versine = 0.5 if angle < 1e-9 else (1.0 - np.cos(angle)) / (angle * angle)
    a, b, x = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(points)):
        for k in range(3):
            a[k] = points[i, k] - c[k] - shift[k]
        # exp([−δθ]×) a = a − sine δθ × a + versine δθ × (δθ × a)
        w0 = turn[1] * a[2] - turn[2] * a[1]
        w1 = turn[2] * a[0] - turn[0] * a[2]
        w2 = turn[0] * a[1] - turn[1] * a[0]
        b[0] = a[0] - sine * w0 + versine * (turn[1] * w2 - turn[2] * w1)
        b[1] = a[1] - sine * w1 + versine * (turn[2] * w0 - turn[0] * w2)
        b[2] = a[2] - sine * w2 + versine * (turn[0] * w1 - turn[1] * w0)
        for k in range(3):
            x[k] = R[k, 0] * b[0] + R[k, 1] * b[1] + R[k, 2] * b[2]
        depth = rays[i, 0] * x[0] + rays[i, 1] * x[1] + rays[i, 2] * x[2]
        for part in range(2):
            m = tangents[i, part]
            out[2 * i + part] = (m[0] * x[0] + m[1] * x[1] + m[2] * x[2]) / depth


@njit(cache=True)
def _moved(root: FloatArray, k: int, m: int, by_k: float, by_m: float, out: FloatArray) -> None:
    """Fill a step (6,) along columns k and m of the root, in tenths of a sigma."""
    for i in range(6):
        out[i] = _STEP * (by_k * root[i, k] + by_m * root[i, m])


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
    J = np.empty((count, 6))
    ab, ba, aa, bb = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    step, other = np.zeros(6), np.zeros(6)
    _residuals(points, rays, tangents, R, c, step, middle)
    for k in range(6):
        _moved(root, k, k, 0.5, 0.5, step)
        _moved(root, k, k, -0.5, -0.5, other)
        _residuals(points, rays, tangents, R, c, step, aa)
        _residuals(points, rays, tangents, R, c, other, bb)
        for i in range(count):
            J[i, k] = (aa[i] - bb[i]) / (2.0 * _STEP)
            bent[k, k, i] = (aa[i] + bb[i] - 2.0 * middle[i]) / _STEP**2
        for m in range(k):
            _moved(root, k, m, 1.0, 1.0, step)
            _moved(root, k, m, -1.0, -1.0, other)
            _residuals(points, rays, tangents, R, c, step, aa)
            _residuals(points, rays, tangents, R, c, other, bb)
            _moved(root, k, m, 1.0, -1.0, step)
            _moved(root, k, m, -1.0, 1.0, other)
            _residuals(points, rays, tangents, R, c, step, ab)
            _residuals(points, rays, tangents, R, c, other, ba)
            for i in range(count):
                bent[k, m, i] = (aa[i] + bb[i] - ab[i] - ba[i]) / (4.0 * _STEP**2)
                bent[m, k, i] = bent[k, m, i]
    out, pull = np.zeros((6, 6)), np.empty(6)
    for k in range(6):
        for m in range(6):
            for a in range(6):
                pull[a] = 0.0
                for i in range(count):
                    pull[a] += J[i, a] * bent[k, m, i]
            for a in range(6):
                for b in range(6):
                    out[a, b] += 0.5 * pull[a] * pull[b]
    return out
