"""The ratio of measured to predicted motion: found where it is one factor, not where the scene moves by itself."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.arrays import FloatArray
from groundstation.integrity.motion_scale import MotionScale, motion_scale


def motions(
    rng: np.random.Generator, factor: float, *, even: bool = False, drift_px: float = 0.0, wrong: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Measured and predicted motions (60, 2), px, of a head that turns evenly or not; some pairs are ``wrong``."""
    predicted = np.tile([15.0, 4.0], (60, 1)) + (0.3 if even else 6.0) * rng.normal(size=(60, 2))
    measured = factor * predicted + [drift_px, 0.0] + rng.normal(0.0, 0.5, (60, 2))
    bad = rng.uniform(size=60) < wrong
    measured[bad] = rng.normal(0.0, 20.0, (int(bad.sum()), 2))
    return measured, predicted


def scale_of(measured: FloatArray, predicted: FloatArray) -> MotionScale | None:
    return motion_scale(measured, predicted, np.ones(len(measured), np.bool_))


@settings(max_examples=60, deadline=None)
@given(factor=st.floats(0.6, 1.6), wrong=st.floats(0.0, 0.2), seed=st.integers(0, 10_000))
def test_a_factor_is_found_and_its_sigma_is_true(factor: float, wrong: float, seed: int) -> None:
    found = scale_of(*motions(np.random.default_rng(seed), factor, wrong=wrong))
    if abs(factor - 1.0) <= 0.03:
        assert found is None
    if abs(factor - 1.0) >= 0.1:
        assert found is not None
        # five sigma of the median, and what wrong pairs move it by
        assert abs(found.ratio - factor) <= 5.0 * found.sigma + 0.05 * wrong


@settings(max_examples=60, deadline=None)
@given(drift_px=st.floats(-8.0, 8.0), even=st.booleans(), seed=st.integers(0, 10_000))
def test_clouds_that_drift_are_no_factor(drift_px: float, even: bool, seed: int) -> None:
    measured, predicted = motions(np.random.default_rng(seed), 1.0, even=even, drift_px=drift_px)
    assert scale_of(measured, predicted) is None


def test_few_pairs_say_nothing() -> None:
    measured, predicted = motions(np.random.default_rng(1), 0.7)
    few = np.arange(60) < 19
    assert motion_scale(measured, predicted, few) is None
    assert scale_of(measured, predicted) is not None
