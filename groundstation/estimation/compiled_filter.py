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


def innovation_covariance(P: FloatArray, H: FloatArray, R: FloatArray) -> FloatArray:
    """Return S = H P Hᵀ + R, (m, m)."""
    S = np.empty_like(R)
    write_innovation_covariance(P, H, R, S)
    return S


# results are handed in, not returned: a compiled function takes longer to return an array than to fill it
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

    For two or three numbers measured at once a general solver takes longer to begin than to solve. As that one it
    raises `LinAlgError` where A is singular, or either is not finite.
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
    """Return the state (n,) that one update would lead to: where to linearise once more."""
    moved = x.copy()
    _move_to_trial(P, H, R, residual, estimated, moved)
    return moved


@njit(cache=True)
def _move_to_trial(
    P: FloatArray, H: FloatArray, R: FloatArray, residual: FloatArray, estimated: BoolArray, moved: FloatArray
) -> None:
    """Add to a state (n,) what one update would."""
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
    H: FloatArray,
    R: FloatArray,
    residual: FloatArray,
    estimated: BoolArray,
    share: float,
    new_x: FloatArray,
    new_P: FloatArray,
    Kt: FloatArray,
    S: FloatArray,
) -> None:
    """Write state and covariance after one update in Joseph form, with the gain Kᵀ (m, n) and S (m, m).

    The gain is the optimal one times ``share``. (I − K H) P (I − K H)ᵀ + K R Kᵀ, multiplied out from the left in steps
    of n² m, since K and H are thin.
    """
    m, n = H.shape
    # one row for each number measured: the inner loops then run along rows
    HP = np.empty((m, n))
    project_into(P, H, R, HP, S)
    Kt[:] = HP
    solve_small(S.copy(), Kt)
    for a in range(m):
        for i in range(n):
            Kt[a, i] = Kt[a, i] * share if estimated[i] else 0.0
    # numbers are addressed in place: a row taken out as an array of its own costs as much as what is done to it
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
    # what is left of the right-hand factor: −((I − K H) P Hᵀ) Kᵀ + K R Kᵀ
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
                total -= new_P[i, columns[c]] * H[a, columns[c]]
            for b in range(m):
                total += Kt[b, i] * R[b, a]
            rest[a, i] = total
    for a in range(m):
        for i in range(n):
            gain = rest[a, i]
            for j in range(n):
                new_P[i, j] += gain * Kt[a, j]
    for i in range(n):
        for j in range(i):
            new_P[i, j] = new_P[j, i] = 0.5 * (new_P[i, j] + new_P[j, i])


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
    """Write F x and F P Fᵀ + Q; F is nearly diagonal. ``half`` (n, n) is room to work in."""
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
def squared_sigmas(residual: FloatArray, S: FloatArray) -> float:
    """Return residualᵀ S⁻¹ residual of two numbers."""
    a, b = float(residual[0]), float(residual[1])
    return float(
        (S[1, 1] * a * a - (S[0, 1] + S[1, 0]) * a * b + S[0, 0] * b * b) / (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
    )


@njit(cache=True)
def correlated_part(
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
    if residual.size == 2:
        return -0.5 * squared_sigmas(residual, S) - 0.5 * math.log(S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
    return -0.5 * float(residual @ np.linalg.solve(S, residual)) - 0.5 * np.log(np.linalg.det(S))


class CompiledKalmanFilter(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """`ExtendedKalmanFilter` with ``predict`` and a linearised ``correct`` compiled; ``x`` is (n,), ``P`` (n, n)."""

    x: FloatArray
    P: FloatArray
    F: FloatArray
    Q: FloatArray

    def predict(self, u: object = 0) -> None:
        """Carry state and covariance forward by ``F`` and ``Q``; there is no control input."""
        x, P = np.empty_like(self.x), np.empty_like(self.P)
        carry_into(self.x, self.P, self.F, self.Q, np.empty_like(P), x, P)
        self.x, self.P = x, P

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
        m, n = H.shape
        x, P, Kt, S = np.empty(n), np.empty((n, n)), np.empty((m, n)), np.empty((m, m))
        correct_into(self.x, self.P, H, R, residual, estimated, share, x, P, Kt, S)
        self.x, self.P, self.K, self.S, self.y = x, P, Kt.T, S, residual
