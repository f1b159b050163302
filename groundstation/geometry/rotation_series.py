"""Rotations of many epochs at once, equal to those of one epoch to the last bit.

A simulated flight has a hundred thousand inertial samples, and one at a time takes twenty times as long.
"""

import numpy as np

from groundstation.arrays import FloatArray


def matrices_from_wxyz(q_wxyz: FloatArray) -> FloatArray:
    """Return the rotation matrices (n, 3, 3) of unit Hamilton quaternions (n, 4), w first."""
    w, x, y, z = q_wxyz.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def wxyz_from_matrices(matrices: FloatArray) -> FloatArray:
    """Return the unit Hamilton quaternions (n, 4), w ≥ 0, of rotation matrices (n, 3, 3)."""
    m = matrices.transpose(1, 2, 0)
    a, b, c = m[0, 0], m[1, 1], m[2, 2]
    squares = (1 + a + b + c, 1 + a - b - c, 1 - a + b - c, 1 - a - b + c)
    # differences and sums across the diagonal, each by its axis
    dx, dy, dz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    sx, sy, sz = m[2, 1] + m[1, 2], m[0, 2] + m[2, 0], m[1, 0] + m[0, 1]
    products = (
        (squares[0], dx, dy, dz),
        (dx, squares[1], sz, sy),
        (dy, sz, squares[2], sx),
        (dz, sy, sx, squares[3]),
    )
    # by the largest component, so that no division is by a small number
    largest = np.argmax(np.stack(squares), axis=0)
    every = np.stack([np.stack(product, axis=-1) for product in products])
    q = every[largest, np.arange(len(matrices))]
    q = q / _norms(q)[:, None]
    q[q[:, 0] < 0] *= -1.0
    return np.asarray(q)


def rotation_vectors(matrices: FloatArray) -> FloatArray:
    """Return θ (n, 3) in rad, each |θ| ≤ π, with exp([θ]×) the rotation matrices (n, 3, 3)."""
    q = wxyz_from_matrices(matrices)
    w, v = q[:, 0], np.ascontiguousarray(q[:, 1:])
    sine = _norms(v)
    small = sine < 1e-12
    scale = np.where(small, 2.0, 2.0 * np.arctan2(sine, w) / np.where(small, 1.0, sine))
    return np.asarray(scale[:, None] * v)


def matrices_from_vectors(vectors_rad: FloatArray) -> FloatArray:
    """Return exp([θ]×), (n, 3, 3), of rotation vectors θ (n, 3) in rad."""
    half = 0.5 * _norms(vectors_rad)
    share = 0.5 * np.sinc(half / np.pi)
    return matrices_from_wxyz(np.column_stack([np.cos(half), share[:, None] * vectors_rad]))


def _norms(vectors: FloatArray) -> FloatArray:
    """Return the norms (n,) of vectors (n, k), each by one dot product, as `numpy.linalg.norm` has it."""
    return np.asarray(np.sqrt((vectors[:, None, :] @ vectors[:, :, None])[:, 0, 0]))
