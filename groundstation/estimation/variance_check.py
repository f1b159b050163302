"""Variances of the filter before their root or logarithm is taken: a covariance gone indefinite is a numerical failure.

`math.sqrt` and `math.log` of a negative number raise `ValueError`, as anything else does that is given a wrong value. A
numerical failure of the filter is a `LinAlgError`, as of a matrix that cannot be inverted: operation resets the filter.
"""

import math

import numpy as np

from groundstation.arrays import FloatArray


def sigma_of(variance: float, what: str) -> float:
    """Return the root of a variance. Raises `LinAlgError` for one that is negative or not a number."""
    if not variance >= 0.0:
        raise np.linalg.LinAlgError(f"{what}: got a variance of {variance:.4g}, wanted >= 0")
    return math.sqrt(variance)


def require_definite(covariance_px2: FloatArray, what: str) -> None:
    """Raise `LinAlgError` unless a covariance (2, 2) of a pixel, px², is positive definite."""
    a, b, c = float(covariance_px2[0, 0]), float(covariance_px2[1, 1]), float(covariance_px2[0, 1])
    if not (a > 0.0 and b > 0.0 and a * b > c * c):
        got = f"variances of {a:.4g} and {b:.4g} px² with the covariance {c:.4g} px²"
        raise np.linalg.LinAlgError(f"{what}: got {got}, wanted a positive definite matrix")
