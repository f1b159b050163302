"""Dual quaternions: the algebra by its properties, and against pytransform3d, an independent implementation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytransform3d import transformations

from groundstation.geometry.dual_quaternion import (
    DUAL,
    REAL,
    from_pose,
    inverse,
    left_matrix,
    multiply,
    normalised,
    quaternion_product,
    right_matrix,
    transform_point,
    translation_of,
    unit_errors,
)
from groundstation.geometry.rotation import matrix_from_wxyz

numbers = st.floats(-1e3, 1e3, allow_subnormal=False)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
any_quaternions = st.tuples(numbers, numbers, numbers, numbers).map(np.array)
quaternions = any_quaternions.filter(lambda q: np.linalg.norm(q) > 1e-2).map(lambda q: q / np.linalg.norm(q))
motions = st.tuples(quaternions, vectors).map(lambda pose: from_pose(*pose))
IDENTITY = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])


def assert_close(a: np.ndarray, b: np.ndarray, size: float) -> None:
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * (1.0 + size))


@given(any_quaternions, any_quaternions)
def test_products_by_either_matrix_are_the_same(a: np.ndarray, b: np.ndarray) -> None:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    assert_close(left_matrix(a) @ b, right_matrix(b) @ a, size)
    assert abs(np.linalg.norm(quaternion_product(a, b)) - size) <= 1e-11 * (1 + size)


@given(motions, motions, motions)
def test_multiplication_is_associative(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> None:
    assert_close(multiply(multiply(a, b), c), multiply(a, multiply(b, c)), 1e4)


@given(motions)
def test_a_motion_and_its_inverse_cancel(a: np.ndarray) -> None:
    assert_close(multiply(a, inverse(a)), IDENTITY, 1e3)
    assert_close(multiply(inverse(a), a), IDENTITY, 1e3)


@given(motions, motions, vectors)
def test_points_move_as_their_motions_chain(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> None:
    assert_close(transform_point(multiply(a, b), point), transform_point(a, transform_point(b, point)), 1e4)


@given(quaternions, vectors, vectors)
def test_a_point_moves_by_rotation_and_translation(q: np.ndarray, t: np.ndarray, point: np.ndarray) -> None:
    motion = from_pose(q, t)
    assert_close(transform_point(motion, point), matrix_from_wxyz(q) @ point + t, 1e4)
    assert_close(translation_of(motion), t, 1e4)
    assert_close(unit_errors(motion), np.zeros(2), 1e3)


@given(motions, st.floats(0.1, 10.0), st.floats(-5.0, 5.0), vectors)
def test_normalising_keeps_the_motion(a: np.ndarray, scale: float, along: float, point: np.ndarray) -> None:
    """A common scale, and a dual part along the real one, move no point."""
    spoilt = scale * a
    spoilt[DUAL] = spoilt[DUAL] + along * spoilt[REAL]
    again = normalised(spoilt)
    assert_close(unit_errors(again), np.zeros(2), 1e3)
    assert_close(transform_point(again, point), transform_point(a, point), 1e4)


@pytest.mark.parametrize("bad", [np.zeros(8), np.full(8, np.nan)])
def test_what_is_no_motion_is_refused(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match="wanted finite numbers"):
        normalised(bad)


@given(motions, motions, vectors)
def test_against_pytransform3d(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> None:
    theirs = transformations.concatenate_dual_quaternions(a, b)
    assert_close(multiply(a, b), theirs, 1e4)
    # it calls this conjugate the quaternion conjugate
    assert_close(inverse(a), transformations.dq_q_conj(a), 1e3)
    assert_close(transform_point(a, point), transformations.dq_prod_vector(a, point), 1e4)


@given(quaternions, vectors)
def test_poses_against_pytransform3d(q: np.ndarray, t: np.ndarray) -> None:
    theirs = transformations.dual_quaternion_from_pq(np.concatenate([t, q]))
    assert_close(from_pose(q, t), theirs, 1e3)
    matrix = transformations.transform_from_dual_quaternion(from_pose(q, t))
    assert_close(matrix[:3, :3], matrix_from_wxyz(q), 1.0)
    assert_close(matrix[:3, 3], t, 1e3)
