"""Information matrices JᵀWJ of a fit: their conditioning and their inverses.

Parameters differ in unit by many orders of magnitude (rad, m, px, s). Each matrix is therefore scaled to unit diagonal
before its eigenvalues are compared with a threshold.
"""

import numpy as np

from groundstation.arrays import FloatArray

# eigenvalues of the scaled matrix below this are rounding errors
_LEAST_EIGENVALUE = 1e-13
_LEAST_SHARE = 1e-14
# a parameter with this part in an unobservable direction is unobservable
_UNOBSERVABLE_PART = 1e-3


def unit_diagonal(information: FloatArray) -> FloatArray:
    """Return the information (p, p) with its parameters scaled to unit diagonal."""
    scale = _scale(information)
    return np.asarray(information / np.outer(scale, scale))


def well_conditioned(information: FloatArray) -> bool:
    """Return whether the information (p, p), scaled to unit diagonal, can be inverted."""
    if not np.all(np.diag(information) > 0):
        return False
    return bool(np.linalg.cond(unit_diagonal(information)) < 1.0 / _LEAST_EIGENVALUE)


def inverse(information: FloatArray) -> FloatArray:
    """Return the pseudo-inverse (p, p) of an information, inverted at unit diagonal."""
    scale = _scale(information)
    unit = information / np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(unit, rcond=_LEAST_SHARE, hermitian=True) / np.outer(scale, scale))


def inverse_with_unobservable(information: FloatArray) -> FloatArray:
    """Return the inverse (p, p); infinite variances of parameters that the information does not determine."""
    scale = _scale(information)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    null = values < _LEAST_EIGENVALUE
    covariance = (vectors[:, ~null] / values[~null]) @ vectors[:, ~null].T / np.outer(scale, scale)
    unobservable = np.abs(vectors[:, null]).max(axis=1, initial=0.0) > _UNOBSERVABLE_PART
    covariance[unobservable, unobservable] = np.inf
    return np.asarray(covariance)


def inverse_with_floor(information: FloatArray) -> FloatArray:
    """Return the inverse (p, p) with eigenvalues raised to 1e-14 of the largest: large, finite variances."""
    values, vectors = np.linalg.eigh(information)
    values = np.maximum(values, _LEAST_SHARE * max(float(values.max()), 1e-300))
    return np.asarray(vectors / values @ vectors.T)


def _scale(information: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.maximum(np.diag(information), 1e-300)))
