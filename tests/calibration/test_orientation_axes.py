"""Axes made of pairs of directions."""

import numpy as np
import pytest

from calibration.orientation import _triads


@pytest.mark.parametrize("pairs", [1, 2, 3, 7])
def test_axes_are_right_handed_and_of_unit_length(rng: np.random.Generator, pairs: int) -> None:
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, pairs, 3)))
    axes = _triads(a, b)
    np.testing.assert_allclose(axes.transpose(0, 2, 1) @ axes, np.tile(np.eye(3), (pairs, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(axes), 1.0, atol=1e-12)
    # the first halves the pair, the last stands on both
    np.testing.assert_allclose(np.einsum("hi,hi->h", axes[:, :, 0], a - b), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("hi,hi->h", axes[:, :, 2], a), 0.0, atol=1e-12)
