"""filterpy's extended Kalman filter with its arithmetic compiled: the same equations, without the copies.

A pair of frames brings a dozen encoder readings, each a prediction and a correction of its own, and for
matrices of fourteen rows the interpreter takes far longer than the sums.
"""

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numba import njit

from groundstation.arrays import FloatArray


@njit(cache=True)
def innovation_covariance(P: FloatArray, H: FloatArray, R: FloatArray) -> FloatArray:
    """Return S = H P Hᵀ + R, (m, m)."""
    m, n = H.shape
    S = R.copy()
    for a in range(m):
        for i in range(n):
            if H[a, i] != 0.0:
                for b in range(m):
                    total = 0.0
                    for j in range(n):
                        total += P[i, j] * H[b, j]
                    S[a, b] += H[a, i] * total
    return S


@njit(cache=True)
def _correct(
    x: FloatArray, P: FloatArray, H: FloatArray, R: FloatArray, residual: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return state and covariance after one update in Joseph form, with the gain K and S."""
    m, n = H.shape
    PHt = np.zeros((n, m))
    for i in range(n):
        for a in range(m):
            for j in range(n):
                PHt[i, a] += P[i, j] * H[a, j]
    S = innovation_covariance(P, H, R)
    K = np.ascontiguousarray(np.linalg.solve(S, PHt.T).T)
    new_x = x.copy()
    left = np.zeros((n, n))
    for i in range(n):
        left[i, i] = 1.0
        for a in range(m):
            new_x[i] += K[i, a] * residual[a]
            for j in range(n):
                left[i, j] -= K[i, a] * H[a, j]
    half = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            if left[i, k] != 0.0:
                for j in range(n):
                    half[i, j] += left[i, k] * P[k, j]
    KR = np.zeros((n, m))
    for i in range(n):
        for a in range(m):
            for b in range(m):
                KR[i, a] += K[i, b] * R[b, a]
    new_P = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += half[i, k] * left[j, k]
            for a in range(m):
                total += KR[i, a] * K[j, a]
            new_P[i, j] = total
    return new_x, new_P, K, S


@njit(cache=True)
def _carry(x: FloatArray, P: FloatArray, F: FloatArray, Q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return F x and F P Fᵀ + Q; F is nearly diagonal."""
    n = x.size
    new_x, half, new_P = np.zeros(n), np.zeros((n, n)), Q.copy()
    for i in range(n):
        for k in range(n):
            f = F[i, k]
            if f != 0.0:
                new_x[i] += f * x[k]
                for j in range(n):
                    half[i, j] += f * P[k, j]
    for j in range(n):
        for k in range(n):
            f = F[j, k]
            if f != 0.0:
                for i in range(n):
                    new_P[i, j] += half[i, k] * f
    return new_x, new_P


class CompiledKalmanFilter(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """`ExtendedKalmanFilter` with ``predict`` and a linearised ``correct`` compiled; ``x`` is (n,), ``P`` (n, n)."""

    x: FloatArray
    P: FloatArray
    F: FloatArray
    Q: FloatArray

    def predict(self, u: object = 0) -> None:
        """Carry state and covariance forward by ``F`` and ``Q``; there is no control input."""
        self.x, self.P = _carry(self.x, self.P, self.F, self.Q)

    def correct(self, residual: FloatArray, H: FloatArray, R: FloatArray) -> None:
        """Fuse a residual (m,) with Jacobian ``H`` (m, n) and noise ``R`` (m, m), in Joseph form."""
        self.x, self.P, self.K, self.S = _correct(self.x, self.P, H, R, residual)
        self.y = residual
