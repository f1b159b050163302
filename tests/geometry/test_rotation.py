"""Quaternions, rotation vectors and matrices agree, with each other and with SciPy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from groundstation.geometry.angles import wrap_rad
from groundstation.geometry.rotation import (
    cross,
    matrix_from_wxyz,
    rotation_from_vector,
    rotation_x,
    rotation_z,
    wxyz_from_matrix,
)

components = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: math.hypot(*q) > 0.1)


@given(components)
def test_quaternion_to_matrix_and_back(q: list[float]) -> None:
    unit = np.array(q) / math.hypot(*q)
    m = matrix_from_wxyz(unit)
    np.testing.assert_allclose(m @ m.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(m) == pytest.approx(1.0)
    back = wxyz_from_matrix(m)
    assert abs(float(back @ unit)) == pytest.approx(1.0, abs=1e-12)
    assert back[0] >= 0


def test_elementary_rotations_are_right_handed() -> None:
    quarter = math.pi / 2
    np.testing.assert_allclose(rotation_z(quarter) @ [1, 0, 0], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(rotation_x(quarter) @ [0, 1, 0], [0, 0, 1], atol=1e-15)
    half = np.array([math.cos(quarter / 2), 0, 0, math.sin(quarter / 2)])
    np.testing.assert_allclose(matrix_from_wxyz(half), rotation_z(quarter), atol=1e-15)


@given(st.floats(-1e6, 1e6))
def test_wrapping(angle: float) -> None:
    wrapped = wrap_rad(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-6)
    assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-6)


def test_the_same_rotations_as_scipy(rng: np.random.Generator) -> None:
    for vector in rng.normal(0.0, 2.0, (50, 3)):
        theirs = Rotation.from_rotvec(vector)
        matrix = theirs.as_matrix()
        np.testing.assert_allclose(rotation_from_vector(vector), matrix, atol=1e-14)
        np.testing.assert_allclose(wxyz_from_matrix(matrix), theirs.as_quat(canonical=True)[[3, 0, 1, 2]], atol=1e-14)
        np.testing.assert_allclose(matrix_from_wxyz(wxyz_from_matrix(matrix)), matrix, atol=1e-14)


def test_the_cross_product_is_numpys_to_the_last_bit(rng: np.random.Generator) -> None:
    for a, b in rng.normal(size=(100, 2, 3)):
        np.testing.assert_array_equal(cross(a, b), np.cross(a, b))
