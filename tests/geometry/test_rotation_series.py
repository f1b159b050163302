"""Rotations of many epochs are those of one epoch, to the last bit."""

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_from_vector, wxyz_from_matrix
from groundstation.geometry.rotation_series import (
    matrices_from_vectors,
    matrices_from_wxyz,
    rotation_vectors,
    wxyz_from_matrices,
)
from groundstation.onboard.pose.inertial_filter import rotation_vector


@pytest.fixture
def turns(rng: np.random.Generator) -> FloatArray:
    """Rotation vectors (n, 3), of all sizes up to half a turn: none, tiny ones and half turns included."""
    axes = rng.standard_normal((400, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    sizes = np.concatenate([np.zeros(2), np.geomspace(1e-14, 1.0, 198), rng.uniform(0.0, np.pi, 197), [np.pi] * 3])
    return np.vstack([sizes[:, None] * axes, np.pi * np.eye(3)])


def test_quaternions_and_matrices(turns: FloatArray) -> None:
    matrices = np.array([rotation_from_vector(turn) for turn in turns])
    quaternions = np.array([wxyz_from_matrix(m) for m in matrices])
    # each component is the largest one of some
    assert set(np.argmax(np.abs(quaternions), axis=1)) == {0, 1, 2, 3}
    np.testing.assert_array_equal(wxyz_from_matrices(matrices), quaternions)
    np.testing.assert_array_equal(matrices_from_wxyz(quaternions), [matrix_from_wxyz(q) for q in quaternions])


def test_rotation_vectors(turns: FloatArray) -> None:
    matrices = matrices_from_vectors(turns)
    np.testing.assert_allclose(matrices, [rotation_from_vector(turn) for turn in turns], rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(rotation_vectors(matrices), [rotation_vector(m) for m in matrices])
    below = np.linalg.norm(turns, axis=1) < 3.0
    np.testing.assert_allclose(rotation_vectors(matrices)[below], turns[below], rtol=0.0, atol=1e-12)
