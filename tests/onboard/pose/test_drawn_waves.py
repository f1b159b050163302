"""The gusts of a simulated approach: no preferred phase, the size that is wanted, periods in their range."""

import numpy as np
import pytest

from groundstation.onboard.pose.simulated_approach import waves


def test_waves_have_no_preferred_phase_and_the_stated_size(rng: np.random.Generator) -> None:
    drawn = np.array([waves(np.array([0.0, 3.0]), (2.0, 8.0), 2.0, rng) for _ in range(3000)])
    assert drawn.mean(axis=0) == pytest.approx([0.0, 0.0], abs=4 * 2.0 / np.sqrt(3000))
    assert drawn.std(axis=0) == pytest.approx([2.0, 2.0], rel=0.06)


def test_their_periods_are_within_the_range(rng: np.random.Generator) -> None:
    t = np.arange(0.0, 4000.0, 0.25)
    power = np.abs(np.fft.rfft(waves(t, (2.0, 8.0), 1.0, rng))) ** 2
    period_s = 1.0 / np.maximum(np.fft.rfftfreq(len(t), 0.25), 1e-9)
    within = (period_s > 1.99) & (period_s < 8.05)
    assert power[within].sum() > 0.99 * power.sum()
