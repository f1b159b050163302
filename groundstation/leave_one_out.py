"""One station's pixel against the fix of the others: the algebra of `groundstation.solution_separation`, compiled."""

import math

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray

LEAST_SHARE = 1e-2  # of the information in one direction: what is less is none
# of an epoch: A₀₀, A₀₁, A₁₁, g₀, g₁, the variances of its noise and of its constant error, px²
PART_SIZE = 7


@njit(cache=True)
def leave_out(noises: FloatArray, jacobians: FloatArray, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return A (2, 2) and g (2,) of the first of k stations against the fix of the others.

    With the others' information J = Σ Hᵀ W H and pull c = Σ Hᵀ W r, and the station's own H₀, W₀, r₀: eliminating the
    target from all of them, g = W₀ (r₀ − H₀ δ̂) and A = W₀ − W₀ H₀ (J + H₀ᵀ W₀ H₀)⁻¹ H₀ᵀ W₀.

    Parameters
    ----------
    noises : (k, 2, 2) covariances W⁻¹, px².
    jacobians : (k, 2, 3) H, px per m.
    residuals : (k, 2) r, px.
    """
    J, c = np.zeros((3, 3)), np.zeros(3)
    for k in range(len(noises)):
        H = jacobians[k]
        HtW = H.T.copy() @ np.linalg.inv(noises[k])
        J += HtW @ H
        c += HtW @ residuals[k]
    own, H = np.linalg.inv(noises[0]), jacobians[0]
    moved = np.linalg.solve(J, c)
    A = own - own @ H @ np.linalg.solve(J, H.T.copy() @ own)
    return 0.5 * (A + A.T), own @ (residuals[0] - H @ moved)


@njit(cache=True)
def whitened(residual: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return L⁻¹ r (2,) of a residual (2,) with covariance (2, 2) = L Lᵀ."""
    L = np.linalg.cholesky(covariance)
    first = residual[0] / L[0, 0]
    return np.array([first, (residual[1] - L[1, 0] * first) / L[1, 1]])


def explained(A: FloatArray, g: FloatArray) -> float:
    """Return gᵀ A⁺ g of a symmetric A (2, 2); directions of less than `LEAST_SHARE` of the largest count as none."""
    a, b, c = float(A[0, 0]), float(A[0, 1]), float(A[1, 1])
    middle, radius = 0.5 * (a + c), math.hypot(0.5 * (a - c), b)
    turn = 0.5 * math.atan2(2.0 * b, a - c)
    along = math.cos(turn) * float(g[0]) + math.sin(turn) * float(g[1])
    across = math.cos(turn) * float(g[1]) - math.sin(turn) * float(g[0])
    large, small = middle + radius, middle - radius
    if large <= 0.0:
        return 0.0
    return along**2 / large + (across**2 / small if small > LEAST_SHARE * large else 0.0)


@njit(cache=True)
def summed_up(parts: FloatArray, count: int, bias: FloatArray) -> tuple[float, int]:
    """Write b̂ = A⁺ g (2,) of the sums over the first ``count`` epochs (k, 7); return T and its degrees of freedom.

    A direction that the others say nothing of, across the line of sight of two stations, is left out.
    """
    sums = np.zeros(PART_SIZE)
    for k in range(count):
        for j in range(PART_SIZE):
            sums[j] += parts[k, j]
    noise, constant = sums[5] / count, sums[6] / count
    values, vectors = np.linalg.eigh(np.array([[sums[0], sums[1]], [sums[1], sums[2]]]))
    bias[:] = 0.0
    dof = 0
    for k in range(2):
        if values[k] > LEAST_SHARE * count / noise:
            dof += 1
            along = (vectors[0, k] * sums[3] + vectors[1, k] * sums[4]) / values[k]
            for a in range(2):
                bias[a] += vectors[a, k] * along
    return (sums[3] * bias[0] + sums[4] * bias[1]) / (1.0 + count * constant / noise), dof


@njit(cache=True)
def held_against(
    jacobian: FloatArray,
    H: FloatArray,
    constant: int,
    x: FloatArray,
    P: FloatArray,
    angle_sigma_rad: float,
    residual: FloatArray,
    noise: FloatArray,
) -> float:
    """Take what the rig's learnt errors make off a residual (2,), and add the angles' noise to a pixel's (2, 2).

    ``jacobian`` (2, 5) by point and angles, ``H`` (2, n) by the state, whose errors of the rig begin at ``constant``.
    Returns the sum of the variances, px², that those errors cause.
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
    held_against(np.zeros((2, 5)), np.zeros((2, 3)), 1, np.zeros(3), np.eye(3), 0.0, np.zeros(2), np.zeros((2, 2)))
    leave_out(np.tile(np.eye(2), (2, 1, 1)), np.sqrt(np.arange(12.0)).reshape(2, 2, 3), np.zeros((2, 2)))
    whitened(np.zeros(2), np.eye(2))
    summed_up(np.ones((2, PART_SIZE)), 1, np.zeros(2))
