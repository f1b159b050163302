"""The compiled kernels agree with filterpy's arithmetic."""

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.estimation.filterpy_ekf import FilterpyEkf
from groundstation.estimation.imm import ImmFilter
from groundstation.estimation.kalman_kernels import (
    LinearMeasurement,
    correct_into,
    innovation_covariance,
    solve_small,
)

N = 14
ALL = np.ones(N, np.bool_)


def spread(rng: np.random.Generator, size: int) -> FloatArray:
    root = rng.normal(size=(size, size))
    return np.asarray(root @ root.T + 0.1 * np.eye(size))


def started(x: FloatArray, P: FloatArray) -> ImmFilter:
    one_mode = ImmFilter(N, (5.0,))
    one_mode.set_states(slice(0, N), x, P)
    return one_mode


def test_prediction_and_update_match_filterpy(rng: np.random.Generator) -> None:
    x, P, Q = rng.normal(size=N), spread(rng, N), spread(rng, N)
    F = np.eye(N)
    F[:3, 3:6] = 0.04 * np.eye(3)
    theirs, ours = FilterpyEkf(x, P), started(x, P)
    for _ in range(20):
        theirs.set_motion(F, Q)
        theirs.predict()
        ours.predict(F, [Q], 0.04)
        H, R, residual = rng.normal(size=(2, N)) * (rng.random((2, N)) < 0.5), spread(rng, 2), rng.normal(size=2)
        assert np.allclose(innovation_covariance(ours.P, H, R), H @ theirs.P @ H.T + R, rtol=1e-10)
        measurement = LinearMeasurement(residual, H, R)
        x, P, Kt, S = np.empty(N), np.empty((N, N)), np.empty((2, N)), np.empty((2, 2))
        correct_into(ours.x, ours.P, measurement, ALL, 1.0, x, P, Kt, S)
        theirs.set_measurement(measurement)
        theirs.update(residual)
        ours.correct(measurement, ALL, updates_weights=True)
        for found in (ours.x, x):
            assert np.allclose(found, theirs.x, rtol=1e-8, atol=1e-10)
        for found in (ours.P, P):
            assert np.allclose(found, theirs.P, rtol=1e-8, atol=1e-10)
        assert np.allclose(Kt.T, theirs.K, rtol=1e-8, atol=1e-10)
        assert np.allclose(S, theirs.S, rtol=1e-10)


def test_exact_measurements_leave_no_negative_variance(rng: np.random.Generator) -> None:
    ours = started(rng.normal(size=N), spread(rng, N))
    H = np.zeros((2, N))
    H[0, 0] = H[1, 1] = 1.0
    for _ in range(50):
        ours.correct(LinearMeasurement(np.zeros(2), H, 1e-14 * np.eye(2)), ALL, updates_weights=True)
    assert np.linalg.eigvalsh(0.5 * (ours.P + ours.P.T)).min() > -1e-12


@pytest.mark.parametrize("m", [1, 2, 3])
def test_the_small_solver_is_the_general_one(rng: np.random.Generator, m: int) -> None:
    for _ in range(20):
        A, B = rng.normal(size=(m, m)), rng.normal(size=(m, 7))
        # the first pivot is zero: rows must be exchanged
        A[0, 0] = 0.0 if m > 1 else A[0, 0]
        X = B.copy()
        solve_small(A.copy(), X)
        np.testing.assert_allclose(X, np.linalg.solve(A, B), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("bad", [np.zeros((2, 2)), np.array([[1.0, 2.0], [2.0, 4.0]]), np.full((2, 2), np.nan)])
def test_the_small_solver_refuses_the_same_matrices_as_the_general_one(bad: FloatArray) -> None:
    """So that numbers no filter can work with are still a fault that the pipeline begins again from."""
    with pytest.raises(np.linalg.LinAlgError):
        solve_small(bad.copy(), np.ones((2, 1)))
