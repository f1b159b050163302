"""Mean and covariance of a grid of log-likelihoods."""

import numpy as np
import pytest

from groundstation.onboard.edges.profile_kernel import moments


@pytest.mark.parametrize("steepness", [0.5, 900.0])
def test_moments_of_a_gaussian_however_steep(steepness: float) -> None:
    """Log-likelihoods thousands apart, of which the exponentials of the smallest would be all 0 or infinite."""
    at = np.arange(41) - 20.0
    grid = -0.5 * steepness * ((at[:, None] - 3.0) ** 2 + (at[None, :] + 2.0) ** 2) - 5e4
    mean, covariance = np.zeros(2), np.zeros((2, 2))
    moments(grid, np.array([0.25, 0.5]), mean, covariance)
    assert mean == pytest.approx([0.75, -1.0], abs=1e-9)
    spread = 1.0 / steepness if steepness < 1.0 else 0.0
    assert covariance == pytest.approx(np.diag([0.25**2, 0.5**2]) * spread, abs=1e-6)
