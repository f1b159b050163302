"""The two unit constraints of a dual quaternion, and their derivative against its numeric twin."""

import numpy as np

from groundstation.onboard.pose.levenberg_marquardt import UNIT_ROOT_WEIGHT, unit_rows


def rows(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    r, J = np.full(4, np.nan), np.full((4, 8), np.nan)
    unit_rows(q, r, J, 1)
    return r, J


def test_a_unit_dual_quaternion_satisfies_both(rng: np.random.Generator) -> None:
    real = rng.normal(size=4)
    real /= np.linalg.norm(real)
    dual = rng.normal(size=4)
    dual -= real * (real @ dual)
    r, _ = rows(np.concatenate([real, dual]))
    np.testing.assert_allclose(r[1:3], 0.0, atol=1e-12 * UNIT_ROOT_WEIGHT)
    assert np.isnan(r[[0, 3]]).all()


def test_the_derivative_is_that_of_the_rows(rng: np.random.Generator) -> None:
    q, step = rng.normal(size=8), 1e-6
    r, J = rows(q)
    expected = np.array([q[:4] @ q[:4] - 1.0, q[:4] @ q[4:]]) * UNIT_ROOT_WEIGHT
    np.testing.assert_allclose(r[1:3], expected, rtol=1e-12)
    for k in range(8):
        up, down = (rows(q + sign * step * np.eye(8)[k])[0][1:3] for sign in (1.0, -1.0))
        np.testing.assert_allclose(J[1:3, k], (up - down) / (2.0 * step), rtol=1e-6, atol=1e-6 * UNIT_ROOT_WEIGHT)
