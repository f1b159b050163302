"""Unit dual quaternions: a rigid motion as eight numbers, q = q_r + ε q_d with q_d = ½ t q_r.

Quaternions are Hamilton, w first. A dual quaternion is one array (8,): the real part (4,), then the dual part (4,).
Named `a_from_b` like any transform: `multiply(a_from_b, b_from_c)` is `a_from_c`.

Not taken from pytransform3d, which needs 2 to 10 times as long (`benchmarks/library_costs.py`) and brings lxml, 12 MB;
the tests compare the two.
"""

import numpy as np

from groundstation.arrays import FloatArray

REAL = slice(0, 4)
DUAL = slice(4, 8)
_VECTOR = slice(1, 4)


def left_matrix(q_wxyz: FloatArray) -> FloatArray:
    """Return L(q), (4, 4), with q ⊗ p = L(q) p."""
    w, x, y, z = q_wxyz
    return np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])


def right_matrix(q_wxyz: FloatArray) -> FloatArray:
    """Return R(q), (4, 4), with p ⊗ q = R(q) p."""
    w, x, y, z = q_wxyz
    return np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])


def quaternion_product(a_wxyz: FloatArray, b_wxyz: FloatArray) -> FloatArray:
    """Return the Hamilton product a ⊗ b, (4,)."""
    return np.asarray(left_matrix(a_wxyz) @ b_wxyz)


def quaternion_conjugate(q_wxyz: FloatArray) -> FloatArray:
    """Return q* (4,): the inverse of a unit quaternion."""
    return np.asarray(q_wxyz) * np.array([1.0, -1.0, -1.0, -1.0])


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the product (8,) of two dual quaternions, ε² = 0."""
    left = left_matrix(a[REAL])
    return np.concatenate([left @ b[REAL], left @ b[DUAL] + left_matrix(a[DUAL]) @ b[REAL]])


def inverse(q: FloatArray) -> FloatArray:
    """Return the inverse motion (8,) of a unit dual quaternion: both parts conjugated."""
    return np.concatenate([quaternion_conjugate(q[REAL]), quaternion_conjugate(q[DUAL])])


def from_pose(q_wxyz: FloatArray, translation: FloatArray) -> FloatArray:
    """Return the dual quaternion (8,) of x ↦ R(q) x + t from a unit quaternion (4,) and t (3,)."""
    return np.concatenate([q_wxyz, 0.5 * quaternion_product(np.array([0.0, *translation]), q_wxyz)])


def translation_of(q: FloatArray) -> FloatArray:
    """Return t (3,) = vec(2 q_d ⊗ q_r*) / |q_r|²; a common scale of both parts cancels."""
    real = q[REAL]
    return np.asarray(2.0 * quaternion_product(q[DUAL], quaternion_conjugate(real))[_VECTOR] / (real @ real))


def normalised(q: FloatArray) -> FloatArray:
    """Return the unit dual quaternion (8,) of the same motion: |q_r| = 1 and q_r · q_d = 0.

    The part of q_d along q_r, which moves no point, is taken off. Raises `ValueError` for a real part of zero.
    """
    length = float(np.linalg.norm(q[REAL]))
    if not length > 0.0 or not np.isfinite(q).all():
        raise ValueError(f"got a dual quaternion {q}; wanted finite numbers and a real part that is not zero")
    real, dual = q[REAL] / length, q[DUAL] / length
    return np.concatenate([real, dual - (real @ dual) * real])


def unit_errors(q: FloatArray) -> FloatArray:
    """Return (2,) q_rᵀ q_r − 1 and q_rᵀ q_d: both zero for a unit dual quaternion."""
    return np.array([q[REAL] @ q[REAL] - 1.0, q[REAL] @ q[DUAL]])


def transform_point(q: FloatArray, point: FloatArray) -> FloatArray:
    """Return R x + t (3,): the point x moved by a unit dual quaternion, q (1 + ε x) q̄* in its dual part."""
    moved = multiply(multiply(q, np.concatenate([[1.0, 0, 0, 0], [0.0], point])), _both_conjugates(q))
    return np.asarray(moved[DUAL][_VECTOR])


def _both_conjugates(q: FloatArray) -> FloatArray:
    """Return q_r* − ε q_d*."""
    return np.concatenate([quaternion_conjugate(q[REAL]), -quaternion_conjugate(q[DUAL])])
