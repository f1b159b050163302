"""Sums over windows, from which a lag and its sigma are."""

import numpy as np

from groundstation.evaluation.lagging_reference import _MIN_WINDOW_SAMPLES, _windowed


def test_windows_sum_their_content_and_poor_ones_are_skipped() -> None:
    n = _MIN_WINDOW_SAMPLES
    score, information = np.arange(1.0, 2 * n + 1), np.full(2 * n, 4.0)
    lo, hi = np.array([0, n, 0]), np.array([n, 2 * n, n - 1])
    lag, sigma = _windowed(score, information, lo, hi, inflation=9.0)
    np.testing.assert_allclose(lag, [score[:n].sum() / (4.0 * n), score[n:].sum() / (4.0 * n), 0.0])
    np.testing.assert_allclose(sigma, [np.sqrt(9.0 / (4.0 * n))] * 2 + [np.inf])
    lag, sigma = _windowed(score, np.zeros(2 * n), lo, hi, inflation=9.0)
    np.testing.assert_array_equal(lag, 0.0)
    assert np.isinf(sigma).all()
