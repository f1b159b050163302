"""Compiled arithmetic of the filter on two lines: one update, some hundred multiplications."""

import math

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray


@njit(cache=True, nogil=True, error_model="numpy")
def solved(matrix: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return matrix⁻¹ · wanted, of a symmetric positive definite matrix (m, m) and (m, n), by Cholesky's factors.

    NaN where the matrix is not positive definite.
    """
    m, n = wanted.shape
    factor, out = np.zeros((m, m)), np.empty((m, n))
    for i in range(m):
        for j in range(i + 1):
            left = matrix[i, j]
            for k in range(j):
                left -= factor[i, k] * factor[j, k]
            factor[i, j] = math.sqrt(left) if i == j and left > 0.0 else np.nan if i == j else left / factor[j, j]
    for column in range(n):
        for i in range(m):
            left = wanted[i, column]
            for k in range(i):
                left -= factor[i, k] * out[k, column]
            out[i, column] = left / factor[i, i]
        for i in range(m - 1, -1, -1):
            left = out[i, column]
            for k in range(i + 1, m):
                left -= factor[k, i] * out[k, column]
            out[i, column] = left / factor[i, i]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def constrain(gain: FloatArray, innovation: FloatArray, weighted: FloatArray, mean: FloatArray) -> None:
    """Correct the gain's rows of a and b, in place, so that a² + b² = 1; ``weighted`` is S⁻¹ ν."""
    square = 0.0
    for i in range(innovation.size):
        square += innovation[i] * weighted[i]
    if square < 1e-18:
        return
    a, b = mean[0], mean[1]
    for i in range(innovation.size):
        a += gain[0, i] * innovation[i]
        b += gain[1, i] * innovation[i]
    stretch = (1.0 / math.hypot(a, b) - 1.0) / square
    for i in range(innovation.size):
        gain[0, i] += stretch * a * weighted[i]
        gain[1, i] += stretch * b * weighted[i]


@njit(cache=True, nogil=True, error_model="numpy")
def update_kernel(
    mean: FloatArray,
    p: FloatArray,
    h: FloatArray,
    innovation: FloatArray,
    noise: FloatArray,
    new_mean: FloatArray,
    new_p: FloatArray,
    s: FloatArray,
) -> float:
    """Fill the new mean (n,), covariance (n, n) and S (m, m) of `kalman._updated`; returns the NIS."""
    m, n = h.shape
    hp = h @ p
    for i in range(m):
        for j in range(m):
            s[i, j] = noise[i, j]
            for k in range(n):
                s[i, j] += hp[i, k] * h[j, k]
    right = np.empty((m, n + 1))
    right[:, :n] = hp
    right[:, n] = innovation
    right = solved(s, right)
    gain = np.ascontiguousarray(right[:, :n].T)
    weighted = right[:, n].copy()
    constrain(gain, innovation, weighted, mean)
    nis = 0.0
    for i in range(m):
        nis += innovation[i] * weighted[i]
    for i in range(n):
        new_mean[i] = mean[i]
        for j in range(m):
            new_mean[i] += gain[i, j] * innovation[j]
    # with an innovation of nothing the mean was of length 1 already, to rounding
    length = math.hypot(new_mean[0], new_mean[1])
    new_mean[0] /= length
    new_mean[1] /= length
    kept = np.eye(n) - gain @ h
    joseph = kept @ p @ kept.T + gain @ noise @ gain.T
    for i in range(n):
        for j in range(n):
            new_p[i, j] = 0.5 * (joseph[i, j] + joseph[j, i])
    if new_mean[0] < 0.0:
        for i in range(4):
            new_mean[i] = -new_mean[i]
    return nis


@njit(cache=True, nogil=True, error_model="numpy")
def between(
    predicted: FloatArray,
    prior: FloatArray,
    measured: FloatArray,
    noise: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Fill the mean (n,) of a prediction and a measurement of covariances (n, n), and its covariance K·noise."""
    gain = np.ascontiguousarray(solved(prior + noise, prior).T)
    mean[:] = predicted + gain @ (measured - predicted)
    covariance[:] = gain @ noise
