"""New moments of a measured quantity, with states that are only considered: a covariance that stays one."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.estimation.imm import ImmFilter

SIZE = 8


def filter_with(P: np.ndarray) -> ImmFilter:
    bank = ImmFilter(SIZE, (1.0,))
    bank.state = bank.mixed(np.zeros((1, SIZE)), P[None].copy(), np.ones(1))
    return bank


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_shrunk_moments_leave_a_covariance(seed: int) -> None:
    """Expected: of correlated states, two thirds estimated, no eigenvalue below zero, however often it is repeated.

    With the correlations of considered states kept as they are, ten repetitions made one negative.
    """
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(SIZE, SIZE))
    bank, estimated = filter_with(root @ root.T), np.arange(SIZE) < 5
    considered = np.ix_(~estimated, ~estimated)
    before, H = bank.P[considered].copy(), rng.normal(size=(2, SIZE))
    for _ in range(30):
        S = H @ bank.P @ H.T
        bank.replace_moments(H, rng.normal(size=2), 0.6 * S, estimated)
        assert np.linalg.eigvalsh(bank.P).min() > -1e-9 * np.trace(bank.P)
    np.testing.assert_array_equal(bank.P[considered], before)
    np.testing.assert_array_equal(bank.x[~estimated], 0.0)


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 3.0))
def test_the_measured_quantity_gets_its_moments_where_all_is_estimated(seed: int, factor: float) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(SIZE, SIZE))
    bank, H, shift = filter_with(root @ root.T), rng.normal(size=(2, SIZE)), rng.normal(size=2)
    turn = rng.normal(size=(2, 2))
    wanted = factor * turn @ turn.T + 0.01 * np.eye(2)
    bank.replace_moments(H, shift, wanted, np.ones(SIZE, np.bool_))
    np.testing.assert_allclose(H @ bank.P @ H.T, wanted, atol=1e-6 * (1.0 + np.trace(wanted)))
    np.testing.assert_allclose(H @ bank.x, shift, atol=1e-6)
    assert np.linalg.eigvalsh(bank.P).min() > -1e-9 * np.trace(bank.P)


def test_a_quantity_that_is_known_exactly_is_the_schmidt_kalman_filters() -> None:
    """Expected: P_ec − K_e H P_·c and P_cc, as from an exact measurement (Schmidt 1966)."""
    rng = np.random.default_rng(2)
    root = rng.normal(size=(SIZE, SIZE))
    P, H, estimated = root @ root.T, rng.normal(size=(2, SIZE)), np.arange(SIZE) < 5
    bank = filter_with(P)
    bank.replace_moments(H, np.zeros(2), np.zeros((2, 2)), estimated)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T)
    K[~estimated] = 0.0
    left = np.eye(SIZE) - K @ H
    np.testing.assert_allclose(bank.P, left @ P @ left.T, atol=1e-9 * np.trace(P))
