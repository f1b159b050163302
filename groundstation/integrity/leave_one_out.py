"""Leave-one-out residual of a station's pixel to the fix of the others: compiled algebra of `solution_separation`."""

import math

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray
from groundstation.estimation.kalman_kernels import BoolArray, solve_small

LEAST_SHARE = 1e-2  # directions with less than this share of the largest information are not used
# of an epoch: A₀₀, A₀₁, A₁₁, g₀, g₁, the variances of its noise and of its constant error, px²
_A00, _A01, _A11, _G0, _G1, _NOISE, _CONSTANT = 0, 1, 2, 3, 4, 5, 6
TERM_COUNT = 7


@njit(cache=True)
def leave_one_out(
    own: int,
    noises: FloatArray,
    jacobians: FloatArray,
    residuals: FloatArray,
    used: BoolArray,
    A: FloatArray,
    g: FloatArray,
) -> None:
    """Write A (2, 2) and g (2,) of one of k stations against the fix of the others that are used.

    With the information J = Σ Hᵀ W H and c = Σ Hᵀ W r of all used stations, and the station's own H₀, W₀, r₀:
    eliminating the target gives g = W₀ (r₀ − H₀ δ̂) and A = W₀ − W₀ H₀ J⁻¹ H₀ᵀ W₀ with δ̂ = J⁻¹ c.

    Parameters
    ----------
    own : index of the station.
    noises : (k, 2, 2) covariances W⁻¹, px².
    jacobians : (k, 2, 3) H, px per m.
    residuals : (k, 2) r, px.
    used : (k,) whether a station's pixel enters the fix; the station's own always does.
    """
    J = np.zeros((3, 3))
    # columns: c, then the station's own Hᵀ W; both are multiplied by J⁻¹
    right = np.zeros((3, 3))
    own_weight = np.empty((2, 2))
    for k in range(len(noises)):
        if k != own and not used[k]:
            continue
        H, W = jacobians[k], np.eye(2)
        solve_small(noises[k].copy(), W)
        for i in range(3):
            for a in range(2):
                HtW = H[0, i] * W[0, a] + H[1, i] * W[1, a]
                right[i, 0] += HtW * residuals[k, a]
                for j in range(3):
                    J[i, j] += HtW * H[a, j]
                if k == own:
                    right[i, 1 + a] = HtW
        if k == own:
            own_weight[:] = W
    solve_small(J, right)
    H, off = jacobians[own], np.empty(2)
    by_point = np.zeros((2, 2))
    for a in range(2):
        off[a] = residuals[own, a]
        for i in range(3):
            off[a] -= H[a, i] * right[i, 0]
            for b in range(2):
                by_point[a, b] += H[a, i] * right[i, 1 + b]
    for a in range(2):
        g[a] = own_weight[a, 0] * off[0] + own_weight[a, 1] * off[1]
        for b in range(2):
            A[a, b] = own_weight[a, b] - own_weight[a, 0] * by_point[0, b] - own_weight[a, 1] * by_point[1, b]
    A[0, 1] = A[1, 0] = 0.5 * (A[0, 1] + A[1, 0])


@njit(cache=True)
def write_epoch_terms(
    own: int,
    noises: FloatArray,
    jacobians: FloatArray,
    residuals: FloatArray,
    used: BoolArray,
    constant_px2: float,
    most: float,
    part: FloatArray,
) -> None:
    """Write the terms of one epoch of one station for `window_statistic`, ``part`` (7,).

    Arrays are those of `leave_one_out`. ``constant_px2`` is the variance of its constant error; g is scaled down so
    that T of the epoch alone is at most ``most``.
    """
    A, g = np.empty((2, 2)), np.empty(2)
    leave_one_out(own, noises, jacobians, residuals, used, A, g)
    noise = 0.5 * (noises[own, 0, 0] + noises[own, 1, 1])
    share = min(1.0, math.sqrt(most * (1.0 + constant_px2 / noise) / max(separation_statistic(A, g), 1e-12)))
    part[_A00], part[_A01], part[_A11] = A[0, 0], A[0, 1], A[1, 1]
    part[_G0], part[_G1] = g[0] * share, g[1] * share
    part[_NOISE], part[_CONSTANT] = noise, constant_px2


@njit(cache=True)
def whiten(residual: FloatArray, covariance: FloatArray, longest: float, white: FloatArray) -> None:
    """Write L⁻¹ r (2,) of a residual (2,) with covariance (2, 2) = L Lᵀ, limited to the length ``longest``."""
    L = np.linalg.cholesky(covariance)
    white[0] = residual[0] / L[0, 0]
    white[1] = (residual[1] - L[1, 0] * white[0]) / L[1, 1]
    white *= min(1.0, longest / max(math.hypot(white[0], white[1]), 1e-12))


@njit(cache=True)
def separation_statistic(A: FloatArray, g: FloatArray) -> float:
    """Return gᵀ A⁺ g of a symmetric A (2, 2); directions below `LEAST_SHARE` of the largest are left out."""
    a, b, c = A[0, 0], A[0, 1], A[1, 1]
    middle, radius = 0.5 * (a + c), math.hypot(0.5 * (a - c), b)
    turn = 0.5 * math.atan2(2.0 * b, a - c)
    along = math.cos(turn) * g[0] + math.sin(turn) * g[1]
    across = math.cos(turn) * g[1] - math.sin(turn) * g[0]
    large, small = middle + radius, middle - radius
    if large <= 0.0:
        return 0.0
    return float(along**2 / large + (across**2 / small if small > LEAST_SHARE * large else 0.0))


@njit(cache=True)
def window_statistic(parts: FloatArray, count: int, bias: FloatArray) -> tuple[float, int]:
    """Write b̂ = A⁺ g (2,) of the sums over the first ``count`` epochs (k, 7); return T and its degrees of freedom.

    Unobservable directions are left out: with two stations, the one along the epipolar line.
    """
    sums = np.zeros(TERM_COUNT)
    for k in range(count):
        for j in range(TERM_COUNT):
            sums[j] += parts[k, j]
    noise, constant = sums[_NOISE] / count, sums[_CONSTANT] / count
    values, vectors = np.linalg.eigh(np.array([[sums[_A00], sums[_A01]], [sums[_A01], sums[_A11]]]))
    bias[:] = 0.0
    dof = 0
    for k in range(2):
        if values[k] > LEAST_SHARE * count / noise:
            dof += 1
            along = (vectors[0, k] * sums[_G0] + vectors[1, k] * sums[_G1]) / values[k]
            for a in range(2):
                bias[a] += vectors[a, k] * along
    return (sums[_G0] * bias[0] + sums[_G1] * bias[1]) / (1.0 + count * constant / noise), dof


@njit(cache=True)
def subtract_rig_errors(
    jacobian: FloatArray,
    H: FloatArray,
    constant: int,
    x: FloatArray,
    P: FloatArray,
    angle_sigma_rad: float,
    residual: FloatArray,
    noise: FloatArray,
) -> float:
    """Subtract the estimated rig errors from a residual (2,), and add the angle noise to ``noise`` (2, 2).

    ``jacobian`` (2, 5) by point and angles, ``H`` (2, n) by the state, whose rig errors start at index ``constant``.
    Returns the sum of the pixel variances, px², caused by the uncertainty of those errors.
    """
    n, spread = x.size, 0.0
    for a in range(2):
        for k in range(constant, n):
            residual[a] -= H[a, k] * x[k]
            for m in range(constant, n):
                spread += H[a, k] * P[k, m] * H[a, m]
        for b in range(2):
            for k in range(3, 5):
                noise[a, b] += angle_sigma_rad**2 * jacobian[a, k] * jacobian[b, k]
    return spread


def warm_up() -> None:
    """Compile the kernels."""
    subtract_rig_errors(
        np.zeros((2, 5)), np.zeros((2, 3)), 1, np.zeros(3), np.eye(3), 0.0, np.zeros(2), np.zeros((2, 2))
    )
    noises, jacobians = np.tile(np.eye(2), (2, 1, 1)), np.sqrt(np.arange(12.0)).reshape(2, 2, 3)
    write_epoch_terms(0, noises, jacobians, np.zeros((2, 2)), np.ones(2, np.bool_), 0.0, 1.0, np.empty(TERM_COUNT))
    whiten(np.zeros(2), np.eye(2), 1.0, np.empty(2))
    window_statistic(np.ones((2, TERM_COUNT)), 1, np.zeros(2))
