"""The inverse by cofactors, scale included."""

import numpy as np

from groundstation.onboard.edges.line_kernel import inverse_3


def test_it_is_the_inverse_to_the_last_factor(rng: np.random.Generator) -> None:
    for _ in range(20):
        m = rng.normal(size=(3, 3)) + 2.0 * np.eye(3)
        np.testing.assert_allclose(inverse_3(m) @ m, np.eye(3), atol=1e-9)
