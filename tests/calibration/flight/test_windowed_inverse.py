"""Blocks of the inverse of a sparse matrix are those of the whole inverse, whatever the order of its unknowns."""

import numpy as np
import pytest
from scipy.sparse import csc_matrix

from calibration.flight.windowed_inverse import WindowedInverse


def test_windowed_inverse_of_shuffled_unknowns_equals_the_whole_inverse() -> None:
    rng = np.random.default_rng(3)
    L = np.tril(rng.normal(size=(40, 40)))
    L -= np.tril(L, -4)
    np.fill_diagonal(L, rng.uniform(1.0, 2.0, 40))
    shuffled = rng.permutation(40)
    N = (L @ L.T)[np.ix_(shuffled, shuffled)]
    windows = [np.flatnonzero((shuffled >= first) & (shuffled < first + 8)) for first in range(0, 40, 8)]
    inverse = WindowedInverse(csc_matrix(N), shuffled.astype(np.float64), windows)
    assert inverse.width == 7
    whole = np.linalg.inv(N)
    for window in windows:
        assert inverse.window(window) == pytest.approx(whole[np.ix_(window, window)], rel=1e-8, abs=1e-10)
