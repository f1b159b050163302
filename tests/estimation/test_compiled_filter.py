"""The compiled filter gives what filterpy's own arithmetic gives."""

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from groundstation.arrays import FloatArray
from groundstation.estimation.compiled_filter import CompiledKalmanFilter, innovation_covariance, solve_small

N = 14


def spread(rng: np.random.Generator, size: int) -> FloatArray:
    root = rng.normal(size=(size, size))
    return np.asarray(root @ root.T + 0.1 * np.eye(size))


def pair(rng: np.random.Generator) -> tuple[ExtendedKalmanFilter, CompiledKalmanFilter]:
    x, P, Q = rng.normal(size=N), spread(rng, N), spread(rng, N)
    F = np.eye(N)
    F[:3, 3:6] = 0.04 * np.eye(3)
    filters = (ExtendedKalmanFilter(dim_x=N, dim_z=2), CompiledKalmanFilter(dim_x=N, dim_z=2))
    for each in filters:
        each.x, each.P, each.Q, each.F = x.copy(), P.copy(), Q.copy(), F.copy()
    return filters


def test_prediction_and_correction_match(rng: np.random.Generator) -> None:
    theirs, ours = pair(rng)
    for _ in range(20):
        theirs.predict()
        ours.predict()
        H, R, residual = rng.normal(size=(2, N)) * (rng.random((2, N)) < 0.5), spread(rng, 2), rng.normal(size=2)
        assert np.allclose(innovation_covariance(ours.P, H, R), H @ theirs.P @ H.T + R, rtol=1e-10)
        predicted = H @ theirs.x
        theirs.update(predicted + residual, lambda _, H=H: H, lambda _, p=predicted: p, R=R)
        ours.correct(residual, H, R)
        assert np.allclose(ours.x, theirs.x, rtol=1e-8, atol=1e-10)
        assert np.allclose(ours.P, theirs.P, rtol=1e-8, atol=1e-10)
        assert np.allclose(ours.K, theirs.K, rtol=1e-8, atol=1e-10)
        assert np.allclose(ours.S, theirs.S, rtol=1e-10)


def test_an_exact_measurement_leaves_no_negative_variance(rng: np.random.Generator) -> None:
    _, ours = pair(rng)
    H = np.zeros((2, N))
    H[0, 0] = H[1, 1] = 1.0
    for _ in range(50):
        ours.correct(np.zeros(2), H, 1e-14 * np.eye(2))
    assert np.linalg.eigvalsh(0.5 * (ours.P + ours.P.T)).min() > -1e-12


@pytest.mark.parametrize("m", [1, 2, 3])
def test_the_small_solver_is_the_general_one(rng: np.random.Generator, m: int) -> None:
    for _ in range(20):
        A, B = rng.normal(size=(m, m)), rng.normal(size=(m, 7))
        # the first pivot is none: rows must change places
        A[0, 0] = 0.0 if m > 1 else A[0, 0]
        X = B.copy()
        solve_small(A.copy(), X)
        np.testing.assert_allclose(X, np.linalg.solve(A, B), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("bad", [np.zeros((2, 2)), np.array([[1.0, 2.0], [2.0, 4.0]]), np.full((2, 2), np.nan)])
def test_the_small_solver_refuses_what_the_general_one_refuses(bad: FloatArray) -> None:
    """So that numbers no filter can work with are still a fault that the pipeline begins anew from."""
    with pytest.raises(np.linalg.LinAlgError):
        solve_small(bad.copy(), np.ones((2, 1)))
