"""One station held against the others: the compiled algebra is the least-squares problem's own."""

import numpy as np
import pytest

from groundstation.integrity.leave_one_out import (
    TERM_COUNT,
    leave_one_out,
    separation_statistic,
    whiten,
    window_statistic,
    write_epoch_terms,
)


@pytest.mark.parametrize("stations", [2, 3, 5])
def test_it_equals_the_bias_after_elimination_of_the_target(rng: np.random.Generator, stations: int) -> None:
    H, r = rng.normal(size=(stations, 2, 3)), rng.normal(size=(stations, 2))
    roots = rng.normal(size=(stations, 2, 2))
    noises = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(2)
    A, g = np.empty((2, 2)), np.empty(2)
    leave_one_out(0, noises, H, r, np.ones(stations, np.bool_), A, g)
    # target and a bias b of the first station as unknowns of one least-squares problem: b has information A, b̂ = A⁻¹ g
    whiten = np.linalg.cholesky(np.linalg.inv(noises)).transpose(0, 2, 1)
    rows = np.zeros((2 * stations, 5))
    for k in range(stations):
        rows[2 * k : 2 * k + 2, :3] = whiten[k] @ H[k]
    rows[:2, 3:] = whiten[0]
    information = rows.T @ rows
    solved = np.linalg.lstsq(rows, np.concatenate([w @ v for w, v in zip(whiten, r, strict=True)]), rcond=None)[0]
    if stations > 2:
        assert np.linalg.inv(A) == pytest.approx(np.linalg.inv(information)[3:, 3:], rel=1e-6)
        assert np.linalg.solve(A, g) == pytest.approx(solved[3:], rel=1e-6)
    else:
        # two cameras do not determine a bias along one direction
        assert abs(np.linalg.det(A)) < 1e-9 * np.trace(A) ** 2


def test_a_whitened_residual_has_the_length_of_its_sigmas(rng: np.random.Generator) -> None:
    covariance, residual = np.array([[4.0, 1.5], [1.5, 2.0]]), rng.normal(size=2)
    white = np.empty(2)
    whiten(residual, covariance, 1e3, white)
    assert white @ white == pytest.approx(residual @ np.linalg.solve(covariance, residual))


def test_a_covariance_that_is_none_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        whiten(np.ones(2), np.array([[1.0, 2.0], [2.0, 1.0]]), 1.0, np.empty(2))


def test_a_whitened_residual_is_as_long_as_it_may_be() -> None:
    white = np.empty(2)
    whiten(np.array([30.0, 40.0]), np.eye(2), 5.0, white)
    assert white == pytest.approx([3.0, 4.0])


@pytest.mark.parametrize("used", [[True, True, True], [False, True, True]])
def test_a_station_is_held_against_those_that_are_used(rng: np.random.Generator, used: list[bool]) -> None:
    """Its own pixels count in any case, those of a third that is left out do not."""
    H, r, noises = rng.normal(size=(4, 2, 3)), rng.normal(size=(4, 2)), np.tile(np.diag([1.0, 2.0]), (4, 1, 1))
    A, g, alone_A, alone_g = np.empty((2, 2)), np.empty(2), np.empty((2, 2)), np.empty(2)
    order = [1, 0, 2]
    leave_one_out(0, noises[:3], H[:3], r[:3], np.ones(3, np.bool_), A, g)
    leave_one_out(1, noises, H[[*order, 3]], r[[*order, 3]], np.array([True, used[0], True, False]), alone_A, alone_g)
    np.testing.assert_allclose(alone_A, A, rtol=1e-9)
    np.testing.assert_allclose(alone_g, g, rtol=1e-9)


@pytest.mark.parametrize("most", [1e9, 1e-3])
def test_an_epochs_part_is_a_and_g_with_its_own_t_bounded(rng: np.random.Generator, most: float) -> None:
    H, r, noises = rng.normal(size=(3, 2, 3)), rng.normal(size=(3, 2)), np.tile(np.diag([1.0, 2.0]), (3, 1, 1))
    used, A, g, part = np.ones(3, np.bool_), np.empty((2, 2)), np.empty(2), np.empty(TERM_COUNT)
    leave_one_out(1, noises, H, r, used, A, g)
    write_epoch_terms(1, noises, H, r, used, 0.3, most, part)
    square = float(g @ np.linalg.solve(A, g))
    assert separation_statistic(A, g) == pytest.approx(square)
    share = min(1.0, (most * (1.0 + 0.3 / 1.5) / square) ** 0.5)
    assert (share == 1.0) is (most > 1.0)
    np.testing.assert_allclose(part, [A[0, 0], A[0, 1], A[1, 1], *(share * g), 1.5, 0.3])


@pytest.mark.parametrize("directions", [1, 2])
def test_summed_up_epochs_are_the_pseudo_inverse_of_their_sums(rng: np.random.Generator, directions: int) -> None:
    """With two stations nothing is known along one direction, and that is no degree of freedom."""
    root = rng.normal(size=(9, 2, 1)) if directions == 2 else np.tile(rng.normal(size=(2, 1)), (9, 1, 1))
    A, noise, constant = root @ root.transpose(0, 2, 1), 1.5, 0.4
    g = (A @ rng.normal(size=2)).reshape(9, 2)
    parts = np.column_stack([A[:, 0, 0], A[:, 0, 1], A[:, 1, 1], g, np.full(9, noise), np.full(9, constant)])
    bias = np.empty(2)
    # values beyond the count are not used
    statistic, dof = window_statistic(np.vstack([parts, np.full((3, 7), np.nan)]), 9, bias)
    wanted = np.linalg.pinv(A.sum(axis=0), rcond=1e-9) @ g.sum(axis=0)
    assert dof == directions
    np.testing.assert_allclose(bias, wanted, rtol=1e-6)
    assert statistic == pytest.approx(float(g.sum(axis=0) @ wanted) / (1.0 + 9 * constant / noise), rel=1e-6)
