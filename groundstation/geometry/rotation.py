"""Rotations as matrices and Hamilton quaternions (w, x, y, z).

Not taken from SciPy's `Rotation`, which needs 1.2 to 5 times as long for one rotation (`benchmarks/library_costs.py`);
the tests compare the two.
"""

import math

import numpy as np

from groundstation.arrays import FloatArray

_SMALL = float(np.finfo(np.float64).eps)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross product of two vectors (3,); NumPy's own takes ten times as long for a single one."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def cross_matrices(vectors: FloatArray) -> FloatArray:
    """Return [v]× (n, 3, 3) of vectors v (n, 3): [v]× a = v × a."""
    matrix = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    matrix[:, 0, 1], matrix[:, 0, 2], matrix[:, 1, 2] = -z, y, -x
    matrix[:, 1, 0], matrix[:, 2, 0], matrix[:, 2, 1] = z, -y, x
    return matrix


def matrix_from_wxyz(q_wxyz: FloatArray) -> FloatArray:
    """Return the (3, 3) rotation matrix of a unit Hamilton quaternion (4,), w first."""
    # Python's numbers: with NumPy's the products take three times as long
    w, x, y, z = map(float, q_wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def wxyz_from_matrix(matrix: FloatArray) -> FloatArray:
    """Return the unit Hamilton quaternion (4,), w ≥ 0, of a (3, 3) rotation matrix.

    The largest of the four components is computed first, so that no division is by a small number.
    """
    # Python's numbers, as in `matrix_from_wxyz`: with NumPy's it takes three times as long
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    squares = [1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i]
    largest = squares.index(max(squares))
    if largest == 0:
        q = np.array([squares[0], h - f, c - g, d - b])
    elif largest == 1:
        q = np.array([h - f, squares[1], d + b, c + g])
    elif largest == 2:
        q = np.array([c - g, d + b, squares[2], h + f])
    else:
        q = np.array([d - b, c + g, h + f, squares[3]])
    q = q / math.sqrt(q.dot(q))
    return -q if q[0] < 0 else q


def rotation_x(angle_rad: float) -> FloatArray:
    """Return Rx, (3, 3): right-handed rotation about x."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(angle_rad: float) -> FloatArray:
    """Return Ry, (3, 3): right-handed rotation about y."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(angle_rad: float) -> FloatArray:
    """Return Rz, (3, 3): right-handed rotation about z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_from_vector(vector_rad: FloatArray) -> FloatArray:
    """Return exp([θ]×), (3, 3), of a rotation vector θ (3,) in rad: axis times angle, right-handed."""
    x, y, z = map(float, vector_rad)
    half = 0.5 * math.sqrt(x * x + y * y + z * z)
    # sin(half)/(2·half) without a division by zero, as `numpy.sinc` computes it, which takes four times as long
    turned = math.pi * (half / math.pi) or _SMALL
    share = 0.5 * float(np.sin(turned) / turned)
    return matrix_from_wxyz(np.array([np.cos(half), share * x, share * y, share * z]))
