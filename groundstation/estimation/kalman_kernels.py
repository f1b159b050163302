"""Compiled kernels of the Kalman filter: prediction, update in Joseph form, innovation covariance.

Two frames bring a dozen encoder readings, each with its own prediction and update; for matrices of fourteen rows and
more the interpreter takes far longer than the arithmetic. `correct_into` also handles consider parameters (Schmidt
1966): their gain is zero, and Joseph's form, which holds for any gain, keeps their covariance and includes their effect
in the other states.

Outputs are arguments: a compiled function takes longer to return an array than to fill it.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray
from groundstation.geometry.mahalanobis import mahalanobis_squared

BoolArray = NDArray[np.bool_]


class LinearMeasurement(NamedTuple):
    """A linearised measurement: residual (m,), Jacobian H (m, n) and noise covariance R (m, m)."""

    residual: FloatArray
    H: FloatArray
    R: FloatArray


def innovation_covariance(P: FloatArray, H: FloatArray, R: FloatArray) -> FloatArray:
    """Return S = H P Hᵀ + R, (m, m)."""
    S = np.empty_like(R)
    write_innovation_covariance(P, H, R, S)
    return S


@njit(cache=True)
def write_innovation_covariance(P: FloatArray, H: FloatArray, R: FloatArray, S: FloatArray) -> None:
    """Write S = H P Hᵀ + R, (m, m)."""
    m, n = H.shape
    S[:] = R
    for a in range(m):
        for i in range(n):
            if H[a, i] != 0.0:
                for b in range(m):
                    total = 0.0
                    for j in range(n):
                        total += P[i, j] * H[b, j]
                    S[a, b] += H[a, i] * total


@njit(cache=True)
def project_into(P: FloatArray, H: FloatArray, R: FloatArray, HP: FloatArray, S: FloatArray) -> None:
    """Write H P (m, n) and S = H P Hᵀ + R (m, m)."""
    m, n = H.shape
    HP[:] = 0.0
    S[:] = R
    for a in range(m):
        line = HP[a]
        for j in range(n):
            h = H[a, j]
            if h != 0.0:
                for i in range(n):
                    line[i] += P[j, i] * h
    for a in range(m):
        for j in range(n):
            if H[a, j] != 0.0:
                for b in range(m):
                    S[a, b] += H[a, j] * HP[b, j]


@njit(cache=True)
def solve_small(A: FloatArray, B: FloatArray) -> None:
    """Solve A X = B in place of B (m, k), by Gaussian elimination with pivots, in place of A (m, m) too.

    For two or three values a general solver takes longer to start than to solve. Like `numpy.linalg.solve` it raises
    `LinAlgError` where A is singular or either is not finite.
    """
    m, k = B.shape
    for a in range(m):
        for b in range(m):
            if not math.isfinite(A[a, b]):
                raise np.linalg.LinAlgError("Array must not contain infs or NaNs.")
        for j in range(k):
            if not math.isfinite(B[a, j]):
                raise np.linalg.LinAlgError("Array must not contain infs or NaNs.")
    for c in range(m):
        pivot = c
        for a in range(c + 1, m):
            if abs(A[a, c]) > abs(A[pivot, c]):
                pivot = a
        if A[pivot, c] == 0.0:
            raise np.linalg.LinAlgError("Matrix is singular to machine precision.")
        if pivot != c:
            for b in range(m):
                A[c, b], A[pivot, b] = A[pivot, b], A[c, b]
            for j in range(k):
                B[c, j], B[pivot, j] = B[pivot, j], B[c, j]
        for a in range(c + 1, m):
            factor = A[a, c] / A[c, c]
            for b in range(c + 1, m):
                A[a, b] -= factor * A[c, b]
            for j in range(k):
                B[a, j] -= factor * B[c, j]
    for c in range(m - 1, -1, -1):
        for a in range(c + 1, m):
            for j in range(k):
                B[c, j] -= A[c, a] * B[a, j]
        inverse = 1.0 / A[c, c]
        for j in range(k):
            B[c, j] *= inverse


def trial_state(
    x: FloatArray, P: FloatArray, H: FloatArray, R: FloatArray, residual: FloatArray, estimated: BoolArray
) -> FloatArray:
    """Return the state (n,) after one update, as the point of the next linearisation."""
    moved = x.copy()
    _move_to_trial(P, H, R, residual, estimated, moved)
    return moved


@njit(cache=True)
def _move_to_trial(
    P: FloatArray, H: FloatArray, R: FloatArray, residual: FloatArray, estimated: BoolArray, moved: FloatArray
) -> None:
    """Add the correction of one update to a state (n,)."""
    m, n = H.shape
    HP, S = np.empty((m, n)), np.empty((m, m))
    project_into(P, H, R, HP, S)
    weighted = residual.copy().reshape((m, 1))
    solve_small(S, weighted)
    for i in range(n):
        if estimated[i]:
            for a in range(m):
                moved[i] += HP[a, i] * weighted[a, 0]


@njit(cache=True)
def correct_into(
    x: FloatArray,
    P: FloatArray,
    measurement: LinearMeasurement,
    estimated: BoolArray,
    share: float,
    new_x: FloatArray,
    new_P: FloatArray,
    Kt: FloatArray,
    S: FloatArray,
) -> None:
    """Write state and covariance after one update in Joseph form, with the gain Kᵀ (m, n) and S (m, m).

    The gain is the optimal one times ``share``; it is zero for states that are not ``estimated`` (n,).
    """
    residual, H, R = measurement
    m, n = H.shape
    # one row for each measured value: the inner loops then run along rows
    HP = np.empty((m, n))
    project_into(P, H, R, HP, S)
    Kt[:] = HP
    solve_small(S.copy(), Kt)
    for a in range(m):
        for i in range(n):
            Kt[a, i] = Kt[a, i] * share if estimated[i] else 0.0
    # elements are addressed in place: a row taken out as an array of its own costs as much as the arithmetic on it
    for i in range(n):
        new_x[i] = x[i]
        for j in range(n):
            new_P[i, j] = P[i, j]
        for a in range(m):
            gain = Kt[a, i]
            new_x[i] += gain * residual[a]
            if gain != 0.0:
                for j in range(n):
                    new_P[i, j] -= gain * HP[a, j]
    _multiply_right_factor(H, R, Kt, new_P)


@njit(cache=True)
def _multiply_right_factor(H: FloatArray, R: FloatArray, Kt: FloatArray, P: FloatArray) -> None:
    """Complete Joseph's form in place: from (I − K H) P to (I − K H) P (I − K H)ᵀ + K R Kᵀ, made symmetric.

    In steps of n² m, since K and H are thin: the second factor adds −((I − K H) P Hᵀ) Kᵀ + K R Kᵀ.
    """
    m, n = H.shape
    columns = np.empty(n, np.int64)
    rest = np.zeros((m, n))
    for a in range(m):
        count = 0
        for j in range(n):
            if H[a, j] != 0.0:
                columns[count] = j
                count += 1
        for i in range(n):
            total = 0.0
            for c in range(count):
                total -= P[i, columns[c]] * H[a, columns[c]]
            for b in range(m):
                total += Kt[b, i] * R[b, a]
            rest[a, i] = total
    for a in range(m):
        for i in range(n):
            gain = rest[a, i]
            for j in range(n):
                P[i, j] += gain * Kt[a, j]
    for i in range(n):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])


@njit(cache=True)
def carry_into(
    x: FloatArray,
    P: FloatArray,
    F: FloatArray,
    Q: FloatArray,
    half: FloatArray,
    new_x: FloatArray,
    new_P: FloatArray,
) -> None:
    """Write F x and F P Fᵀ + Q; F is nearly diagonal. ``half`` (n, n) is a work array."""
    n = x.size
    rows, columns, count = np.empty(n * n, np.int64), np.empty(n * n, np.int64), 0
    for i in range(n):
        for k in range(n):
            if k != i and F[i, k] != 0.0:
                rows[count], columns[count] = i, k
                count += 1
    for i in range(n):
        own, old, line = F[i, i], P[i], half[i]
        new_x[i] = own * x[i]
        for j in range(n):
            line[j] = own * old[j]
    for c in range(count):
        f, line, old = F[rows[c], columns[c]], half[rows[c]], P[columns[c]]
        new_x[rows[c]] += f * x[columns[c]]
        for j in range(n):
            line[j] += f * old[j]
    for i in range(n):
        line, row, noise = half[i], new_P[i], Q[i]
        for j in range(n):
            row[j] = noise[j] + line[j] * F[j, j]
        for c in range(count):
            row[rows[c]] += line[columns[c]] * F[rows[c], columns[c]]


@njit(cache=True)
def correlated_part(
    H: FloatArray, x: FloatArray, covariance: FloatArray, offset: int, share: float, residual: FloatArray
) -> None:
    """Model a ``share`` of a measurement's covariance (2, 2) as the effect of two states at ``offset``, in sigmas.

    Write their columns of H (2, n), the Cholesky factor of the share, and subtract their effect from the residual (2,).
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
    """Return log N(residual; 0, S) of m values, without the constant."""
    if residual.size == 2:
        return -0.5 * mahalanobis_squared(residual, S) - 0.5 * math.log(S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
    return -0.5 * float(residual @ np.linalg.solve(S, residual)) - 0.5 * np.log(np.linalg.det(S))
