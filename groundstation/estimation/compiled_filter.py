"""filterpy's extended Kalman filter with its arithmetic compiled: the same equations, without the copies.

A pair of frames brings a dozen encoder readings, each a prediction and a correction of its own, and for
matrices of fourteen rows and more the interpreter takes far longer than the sums. Besides filterpy's, `correct`
knows states that are only considered (Schmidt 1966): their gain is zero, and Joseph's form, which holds for any
gain, keeps their covariance and lets it into everybody else's.
"""

import math

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray

BoolArray = NDArray[np.bool_]


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
def _projected(P: FloatArray, H: FloatArray, R: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return P Hᵀ, (n, m), and S = H P Hᵀ + R, (m, m)."""
    m, n = H.shape
    PHt, S = np.zeros((n, m)), R.copy()
    for a in range(m):
        for j in range(n):
            if H[a, j] != 0.0:
                for i in range(n):
                    PHt[i, a] += P[j, i] * H[a, j]
    for a in range(m):
        for j in range(n):
            for b in range(m):
                S[a, b] += H[a, j] * PHt[j, b]
    return PHt, S


@njit(cache=True)
def trial_state(
    x: FloatArray, P: FloatArray, H: FloatArray, R: FloatArray, residual: FloatArray, estimated: BoolArray
) -> FloatArray:
    """Return the state (n,) that one update would lead to: where to linearise once more."""
    m, n = H.shape
    PHt, S = _projected(P, H, R)
    weighted = np.linalg.solve(S, residual)
    moved = x.copy()
    for i in range(n):
        if estimated[i]:
            for a in range(m):
                moved[i] += PHt[i, a] * weighted[a]
    return moved


@njit(cache=True)
def correct(
    x: FloatArray,
    P: FloatArray,
    H: FloatArray,
    R: FloatArray,
    residual: FloatArray,
    estimated: BoolArray,
    share: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return state and covariance after one update in Joseph form, with the gain K and S.

    The gain is the optimal one times ``share``. (I − K H) P (I − K H)ᵀ + K R Kᵀ, multiplied out from the left in steps
    of n² m, since K and H are thin.
    """
    m, n = H.shape
    PHt, S = _projected(P, H, R)
    # one row for each number measured: the inner loops then run along rows
    HP = np.ascontiguousarray(PHt.T)
    Kt = np.linalg.solve(S, HP) * share
    for i in range(n):
        if not estimated[i]:
            Kt[:, i] = 0.0
    K = np.ascontiguousarray(Kt.T)
    new_x = x.copy()
    half = P.copy()
    for i in range(n):
        row = half[i]
        for a in range(m):
            new_x[i] += K[i, a] * residual[a]
            gain, line = K[i, a], HP[a]
            for j in range(n):
                row[j] -= gain * line[j]
    # what is left of the right-hand factor: −(half Hᵀ) Kᵀ + K R Kᵀ
    rest = np.zeros((n, m))
    for a in range(m):
        for j in range(n):
            if H[a, j] != 0.0:
                for i in range(n):
                    rest[i, a] -= half[i, j] * H[a, j]
        for i in range(n):
            for b in range(m):
                rest[i, a] += K[i, b] * R[b, a]
    for i in range(n):
        row = half[i]
        for a in range(m):
            gain, line = rest[i, a], Kt[a]
            for j in range(n):
                row[j] += gain * line[j]
    for i in range(n):
        for j in range(i):
            half[i, j] = half[j, i] = 0.5 * (half[i, j] + half[j, i])
    return new_x, half, K, S


@njit(cache=True)
def carry(x: FloatArray, P: FloatArray, F: FloatArray, Q: FloatArray) -> tuple[FloatArray, FloatArray]:
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


@njit(cache=True)
def squared_sigmas(residual: FloatArray, S: FloatArray) -> float:
    """Return residualᵀ S⁻¹ residual of two numbers."""
    a, b = float(residual[0]), float(residual[1])
    return float(
        (S[1, 1] * a * a - (S[0, 1] + S[1, 0]) * a * b + S[0, 0] * b * b) / (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
    )


@njit(cache=True)
def lasting_part(
    H: FloatArray, x: FloatArray, covariance: FloatArray, offset: int, share: float, residual: FloatArray
) -> None:
    """Let a state at ``offset``, two numbers in sigmas, have its ``share`` of a measurement's covariance (2, 2).

    Writes their columns of H (2, n), the share's Cholesky factor, and takes what they make of ``x`` off the residual.
    """
    first = math.sqrt(share * covariance[0, 0])
    across = share * covariance[1, 0] / first
    second = math.sqrt(share * covariance[1, 1] - across * across)
    H[0, offset], H[0, offset + 1] = first, 0.0
    H[1, offset], H[1, offset + 1] = across, second
    residual[0] -= first * x[offset]
    residual[1] -= across * x[offset] + second * x[offset + 1]


@njit(cache=True)
def log_likelihood(residual: FloatArray, S: FloatArray) -> float:
    """Return log N(residual; 0, S) of m numbers, but for the constant."""
    return -0.5 * float(residual @ np.linalg.solve(S, residual)) - 0.5 * np.log(np.linalg.det(S))


class CompiledKalmanFilter(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """`ExtendedKalmanFilter` with ``predict`` and a linearised ``correct`` compiled; ``x`` is (n,), ``P`` (n, n)."""

    x: FloatArray
    P: FloatArray
    F: FloatArray
    Q: FloatArray

    def predict(self, u: object = 0) -> None:
        """Carry state and covariance forward by ``F`` and ``Q``; there is no control input."""
        self.x, self.P = carry(self.x, self.P, self.F, self.Q)

    def correct(
        self,
        residual: FloatArray,
        H: FloatArray,
        R: FloatArray,
        estimated: BoolArray | None = None,
        share: float = 1.0,
    ) -> None:
        """Fuse a residual (m,) with Jacobian ``H`` (m, n) and noise ``R`` (m, m), in Joseph form.

        States that are not ``estimated`` (n,) are considered only: they keep value and variance. ``share`` scales
        the gain.
        """
        if estimated is None:
            estimated = np.ones(self.x.size, np.bool_)
        self.x, self.P, self.K, self.S = correct(self.x, self.P, H, R, residual, estimated, share)
        self.y = residual
