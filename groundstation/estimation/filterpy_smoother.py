"""Backward step of Rauch, Tung & Striebel by filterpy's `KalmanFilter.rts_smoother`.

filterpy takes x⁺ = F x for granted, which a reset is not: the step is given the differences from the filtered means,
for which it is exact. The noise is Q = P⁺ − F P Fᵀ, of a reset or an inflation too. filterpy's inverse of P⁺ is
replaced, as its interface allows, by one in units of the sigmas: states range from 10⁻⁶ rad to 10³ m, and exactly known
ones have no inverse.
"""

import numpy as np
from filterpy.kalman import KalmanFilter

from groundstation.arrays import FloatArray
from groundstation.estimation.smoother_history import RELATIVE_FLOOR, Transition


def rts_step(step: Transition, x_later: FloatArray, P_later: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return smoothed mean (n,) and covariance (n, n) before a transition, given those after it."""
    n = step.x.size
    away = np.array([np.zeros(n), x_later - step.x_next])
    covariances, noise = np.array([step.P, P_later]), step.P_next - step.F @ step.P @ step.F.T
    # filterpy takes F and Q of the later one of two instants
    smoothed, P, _, _ = KalmanFilter(dim_x=n, dim_z=1).rts_smoother(
        away, covariances, [np.eye(n), step.F], [np.zeros((n, n)), noise], inv=_inverse
    )
    return step.x + smoothed[0], 0.5 * (P[0] + P[0].T)


def _inverse(P: FloatArray) -> FloatArray:
    """Return the inverse of a covariance (n, n); exactly known states have zero rows and columns."""
    sigma = np.sqrt(np.maximum(np.diag(P), 0.0))
    known = sigma > 0.0
    units = np.outer(sigma[known], sigma[known])
    correlation = P[np.ix_(known, known)] / units
    np.fill_diagonal(correlation, 1.0 + RELATIVE_FLOOR)
    inverse = np.zeros_like(P)
    inverse[np.ix_(known, known)] = np.linalg.inv(correlation) / units
    return inverse
