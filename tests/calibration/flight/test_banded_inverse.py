"""The inverse within the band is the whole inverse's, and so is what is known of a path's differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import cholesky_banded

from calibration.flight.banded_inverse import banded_inverse
from calibration.flight.smooth_path import find_smoothness, path_basis


@given(st.integers(0, 5), st.integers(1, 30), st.integers(0, 2**31))
def test_it_is_the_inverse_within_the_band(width: int, n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    L = np.tril(rng.normal(size=(n, n)))
    L -= np.tril(L, -width - 1)
    np.fill_diagonal(L, rng.uniform(0.5, 2.0, n))
    N = L @ L.T
    bands = np.zeros((width + 1, n))
    for away in range(min(width, n - 1) + 1):
        bands[away, : n - away] = np.diagonal(N, -away)
    found = banded_inverse(cholesky_banded(bands, lower=True))
    whole = np.linalg.inv(N)
    for away in range(min(width, n - 1) + 1):
        wanted = pytest.approx(np.diagonal(whole, -away), rel=1e-6, abs=1e-9 * float(np.abs(whole).max()))
        assert found[away, : n - away] == wanted


def test_a_break_of_a_path_is_located() -> None:
    t = np.arange(0.0, 40.0, 0.05)
    rng = np.random.default_rng(5)
    path = np.where(t < 25.0, 0.0, 4.0 * (t - 25.0)) + rng.normal(scale=0.01, size=len(t))
    smooth = find_smoothness(path_basis(0.0, 40.0, 0.5), t, path, np.full(len(t), 0.01))
    loose = np.flatnonzero(smooth.difference > 10.0 * np.median(smooth.difference))
    assert len(loose) > 0
    # a difference spans four knots of half a second
    assert np.all(np.abs(0.5 * loose - 25.0) < 3.5)
