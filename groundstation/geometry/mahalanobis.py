"""Squared Mahalanobis distance of two numbers; the only place where a 2×2 covariance is inverted for it."""

from numba import njit

from groundstation.arrays import FloatArray


@njit(cache=True)
def mahalanobis_squared(residual: FloatArray, covariance: FloatArray) -> float:
    """Return rᵀ S⁻¹ r of a residual (2,) with covariance (2, 2); χ² with two degrees of freedom if S is correct."""
    a, b = float(residual[0]), float(residual[1])
    return float(
        (covariance[1, 1] * a * a - (covariance[0, 1] + covariance[1, 0]) * a * b + covariance[0, 0] * b * b)
        / (covariance[0, 0] * covariance[1, 1] - covariance[0, 1] * covariance[1, 0])
    )
