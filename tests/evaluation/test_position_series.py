"""Reading a reference between its fixes, its noise, and the antenna's lever arm."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.evaluation.position_series import (
    ReferenceSeries,
    interpolate,
    nose_from_antenna,
    reference_from_fixes,
    smooth_velocity,
    white_noise_sigma,
)
from groundstation.messages import DgpsFix


def _series(t: np.ndarray, points: np.ndarray) -> ReferenceSeries:
    return ReferenceSeries(t_s=t, position_m=points, sigma_m=np.full_like(points, 0.02))


def test_interpolation_is_linear_and_refuses_gaps_and_ends() -> None:
    t = np.array([0.0, 0.2, 2.0, 2.2])
    at = interpolate(_series(t, np.outer(t, [1.0, 2.0, 3.0])), np.array([-0.1, 0.0, 0.1, 0.2, 1.0, 2.1, 2.2, 2.3]), 0.5)
    np.testing.assert_array_equal(at.usable, [False, True, True, True, False, True, True, False])
    np.testing.assert_allclose(at.position_m[2], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(at.velocity_m_s[2], [1.0, 2.0, 3.0])


def test_interpolation_of_an_empty_series_is_not_usable() -> None:
    assert not interpolate(_series(np.zeros(1), np.zeros((1, 3))), np.array([0.0]), 0.5).usable.any()


def test_noise_is_estimated_from_the_fixes(rng: np.random.Generator) -> None:
    t = np.arange(0, 60, 0.1)
    path = np.column_stack([np.sin(t / 2), 500 - 15 * t, 30 - t])
    noisy = path + rng.normal(size=path.shape) * [0.01, 0.02, 0.03]
    np.testing.assert_allclose(white_noise_sigma(t, noisy), [0.01, 0.02, 0.03], rtol=0.15)
    held = np.concatenate([noisy, np.tile(noisy[-1], (500, 1))])
    longer = np.arange(len(held)) * 0.1
    np.testing.assert_allclose(white_noise_sigma(longer, held), [0.01, 0.02, 0.03], rtol=0.15)


def test_given_sigmas_are_kept_and_unusable_ones_replaced() -> None:
    fixes = [
        DgpsFix(t_s=0.1 * k, position_runway_m=np.array([k, 2.0 * k, 0.0]), sigma_m=np.array([s, s, s]))
        for k, s in enumerate([0.5, 0.0, np.nan])
    ]
    sigma = reference_from_fixes(fixes).sigma_m
    assert sigma[0, 0] == 0.5
    assert np.isfinite(sigma).all()
    assert (sigma > 0).all()


def test_fixes_are_sorted_and_equal_times_dropped() -> None:
    fixes = [DgpsFix(t_s=t, position_runway_m=np.array([t, k, 0.0])) for k, t in enumerate([2.0, 1.0, 1.0, 3.0])]
    found = reference_from_fixes(fixes)
    np.testing.assert_array_equal(found.t_s, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(found.position_m[0], [1.0, 1.0, 0.0])


def test_velocity_of_a_line_is_exact() -> None:
    t = np.sort(np.random.default_rng(1).uniform(0, 10, 60))
    velocity = smooth_velocity(t, np.outer(t, [1.0, -20.0, 0.5]) + 1e4, 0.5)
    np.testing.assert_allclose(velocity, np.tile([1.0, -20.0, 0.5], (60, 1)), rtol=1e-6, atol=1e-6)


def test_lever_arm_of_an_approach() -> None:
    """Flying towards the stations (−y), level: forward is −y, right is −x, down is −z.

    The antenna is 1 m behind the nose, 0.2 m right of it and 0.3 m above.
    """
    t = np.arange(0, 5, 0.1)
    nose = np.column_stack([0 * t, 300 - 15 * t, 20 + 0 * t])
    antenna_in_body = np.array([-1.0, 0.2, -0.3])
    antenna = nose + np.array([-0.2, 1.0, 0.3])
    np.testing.assert_allclose(nose_from_antenna(_series(t, antenna), antenna_in_body).position_m, nose, atol=1e-9)


@given(
    heading=st.floats(-np.pi, np.pi),
    climb=st.floats(-1.2, 1.2),
    arm=st.tuples(*[st.floats(-2, 2)] * 3),
)
def test_lever_arm_keeps_its_length_and_its_forward_part(
    heading: float, climb: float, arm: tuple[float, float, float]
) -> None:
    forward = np.array([np.cos(climb) * np.cos(heading), np.cos(climb) * np.sin(heading), np.sin(climb)])
    t = np.arange(0, 3, 0.1)
    antenna = np.outer(15 * t, forward)
    moved = antenna - nose_from_antenna(_series(t, antenna), np.array(arm)).position_m
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), np.linalg.norm(arm), atol=1e-6)
    np.testing.assert_allclose(moved @ forward, arm[0], atol=1e-6)


def test_lever_arm_while_standing_keeps_the_nearest_heading() -> None:
    """Expected: an aircraft that stops keeps the heading it had; one that never moves is left as it is."""
    t = np.arange(0, 6, 0.1)
    antenna = np.column_stack([0 * t, -10 * np.minimum(t, 3.0), 0 * t])
    moved = nose_from_antenna(_series(t, antenna), np.array([-1.0, 0.0, 0.0])).position_m - antenna
    np.testing.assert_allclose(moved, np.tile([0.0, -1.0, 0.0], (60, 1)), atol=1e-9)
    still = _series(t, np.zeros((60, 3)))
    assert nose_from_antenna(still, np.array([-1.0, 0.0, 0.0])) is still


@pytest.mark.parametrize("n", [0, 1])
def test_too_few_fixes_are_no_reason_to_fail(n: int) -> None:
    fixes = [DgpsFix(t_s=0.0, position_runway_m=np.zeros(3))][:n]
    assert len(reference_from_fixes(fixes)) == n


def test_noise_is_estimated_within_bursts_far_apart(rng: np.random.Generator) -> None:
    """Ten fixes at 10 Hz, then a minute without: the usual spacing is the median's, not the mean's."""
    t = np.concatenate([60.0 * burst + np.arange(10) * 0.1 for burst in range(60)])
    noisy = np.column_stack([0.0 * t, 500 - 0.1 * t, 30 + 0.0 * t]) + rng.normal(size=(len(t), 3)) * [0.01, 0.02, 0.03]
    np.testing.assert_allclose(white_noise_sigma(t, noisy), [0.01, 0.02, 0.03], rtol=0.3)
