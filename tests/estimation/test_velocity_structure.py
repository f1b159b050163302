"""The structure function of the velocity against processes of which it is known."""

import numpy as np
import pytest

from groundstation.estimation.velocity_structure import LAGS_S, VelocityStructure

STEP_S = 0.1


def learnt(velocity_m_s: np.ndarray, sigma_m_s: float = 0.0, seed: int = 0) -> VelocityStructure:
    """The function learnt from velocities (n, 3) every tenth of a second, known to a sigma."""
    generator = np.random.default_rng(seed)
    structure = VelocityStructure()
    for k, v in enumerate(velocity_m_s):
        if structure.is_due(k * STEP_S):
            seen = v + generator.normal(0.0, sigma_m_s, 3)
            structure = structure.sampled(k * STEP_S, seen, np.eye(3) * sigma_m_s**2)
    return structure


def walk(psd: np.ndarray, duration_s: float, seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    steps = generator.normal(0.0, np.sqrt(psd * STEP_S), (round(duration_s / STEP_S), 3))
    return np.cumsum(steps, axis=0)


def test_density_of_white_acceleration() -> None:
    """Its own density at every age, in the mean of forty flights of two minutes, noise of the velocities subtracted."""
    psd = np.array([4.0, 4.0, 1.0])
    found = {age: [] for age in (0.5, 1.5, 3.0, 6.0, 20.0)}
    for seed in range(40):
        structure = learnt(walk(psd, 120.0, seed), 0.5, seed)
        for age, values in found.items():
            values.append(structure.density(age))
    for age, values in found.items():
        mean = np.mean(values, axis=0)
        # the larger of an axis and of the horizontal mean is taken, which is a little more on average
        assert np.all(mean > 0.8 * psd), age
        assert np.all(mean < 1.5 * psd), age


def test_velocity_variance_grows_as_was_seen() -> None:
    """A velocity that returns to its mean: the densities add up to its structure function at each lag."""
    tau_s, sigma_m_s = 3.0, 4.0
    generator = np.random.default_rng(3)
    v = np.zeros((6000, 3))
    kept = np.exp(-STEP_S / tau_s)
    for k in range(1, len(v)):
        v[k] = kept * v[k - 1] + generator.normal(0.0, sigma_m_s * np.sqrt(1.0 - kept**2), 3)
    structure = learnt(v)
    ages = np.arange(0.0, 8.0, 0.01) + 0.005
    grown = np.cumsum([structure.density(age) for age in ages], axis=0) * 0.01
    for lag_s in LAGS_S:
        expected = 2.0 * sigma_m_s**2 * (1.0 - np.exp(-lag_s / tau_s))
        assert grown[round(lag_s / 0.01) - 1] == pytest.approx(np.full(3, expected), rel=0.5)


def test_nothing_is_said_before_enough_was_seen() -> None:
    assert np.all(VelocityStructure().density(1.0) == 0.0)
    assert np.all(learnt(walk(np.full(3, 9.0), 2.0, 1)).density(1.0) == 0.0)
    assert np.all(learnt(walk(np.full(3, 9.0), 6.0, 1)).density(0.5) > 0.0)


def test_vague_velocities_are_not_sampled() -> None:
    structure = learnt(walk(np.full(3, 1.0), 60.0, 1), sigma_m_s=2.5)
    assert not structure.samples
    assert np.all(structure.density(1.0) == 0.0)


def test_another_track_keeps_what_was_learnt_but_no_change_across_the_gap() -> None:
    before = learnt(walk(np.full(3, 4.0), 60.0, 2))
    after = before.interrupted().sampled(61.0, np.full(3, 1000.0), np.zeros((3, 3)))
    assert after.density(1.0) == pytest.approx(before.density(1.0))
    assert np.any(before.density(1.0) > 0.0)
