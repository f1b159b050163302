"""Lattice noise between bounds: the sum itself between them, and beyond the same bound otherwise."""

import numpy as np
import pytest

from groundstation.simulation.scenery.noise_kernels import layers, layers_within


@pytest.mark.parametrize(("low", "high"), [(-0.1, 0.15), (0.3, np.inf), (-np.inf, -0.3), (0.05, 0.05)])
def test_a_sum_that_is_ended_early_is_beyond_the_bound(rng: np.random.Generator, low: float, high: float) -> None:
    ended = 0
    for x, y, covered in zip(*rng.uniform(-50.0, 50.0, (2, 2000)), rng.uniform(0.0, 0.3, 2000), strict=True):
        whole, found = layers(x, y, 1.3, covered, 6, 7), layers_within(x, y, 1.3, covered, 6, 7, low, high)
        if low <= whole <= high:
            assert found == whole
        else:
            assert (found < low) == (whole < low)
            assert (found > high) == (whole > high)
            ended += found != whole
    assert ended > 300
