"""Standstills of a head in a mount's sightings: the rows of each, and the error that they share.

The position of an axis within an encoder's step is unknown; while the head is at rest that error is constant, whatever
the number and times of the readings.
"""

import numpy as np

from groundstation.arrays import FloatArray, IntArray
from groundstation.rig.rig import Station

# of the difference of two readings, in sigmas: further apart, the head has moved
_MOVED_SIGMAS = 6.0
# readings are sums of steps in floating point
_SAME_RAD = 1e-9


def standstills(reading_rad: FloatArray, sense: FloatArray, station: Station) -> IntArray:
    """Return for each of n rows in turn the number of its standstill, (n,).

    ``reading_rad`` (n, 2) as read, ``sense`` (n, 2) how each axis moved last. A row is of the same standstill as the
    one before where both angles differ by no more than noise makes them (of no noise: not at all).
    """
    noise = station.ptu_sigma_rad
    within = _SAME_RAD + (np.sqrt(2.0) * _MOVED_SIGMAS * noise + station.ptu_resolution_rad if noise > 0.0 else 0.0)
    moved = np.zeros(len(reading_rad), dtype=np.bool_)
    moved[1:] = np.abs(np.diff(reading_rad, axis=0)).max(axis=1, initial=0.0) > within
    moved[1:] |= (np.diff(sense, axis=0) != 0.0).any(axis=1)
    return np.cumsum(moved).astype(np.int64)


def with_shared_error(white: FloatArray, by_angle: FloatArray, stand: IntArray, variance: float) -> FloatArray:
    """Return wholly white rows from rows that are white except for an error of both angles shared in each standstill.

    ``white`` (m, k) residuals and derivatives, ``by_angle`` (m, 2) their derivatives by the angles, ``stand`` (m,) its
    standstill's number, ``variance`` of the shared error, rad²; they are returned in the order of standstills. With B
    the rows' ``by_angle`` and BᵀB = V diag(λ) Vᵀ, (I + s² B Bᵀ)^-½ = I + B V diag(((1 + s²λ)^-½ − 1)/λ) Vᵀ Bᵀ.
    """
    order = np.argsort(stand, kind="stable")
    white, by_angle = white[order], by_angle[order]
    _, first, place = np.unique(stand[order], return_index=True, return_inverse=True)
    squares = np.add.reduceat(by_angle[:, :, None] * by_angle[:, None, :], first, axis=0)
    across = np.add.reduceat(by_angle[:, :, None] * white[:, None, :], first, axis=0)
    values, vectors = np.linalg.eigh(squares)
    values = np.maximum(values, np.finfo(np.float64).tiny)
    # ((1 + x)^-½ − 1) without cancellation for small x
    gain = np.expm1(-0.5 * np.log1p(variance * values)) / values
    middle = (vectors * gain[:, None, :]) @ np.swapaxes(vectors, 1, 2) @ across
    return np.asarray(white + (by_angle[:, None, :] @ middle[place])[:, 0])
