"""The simulated approach flies down the glide path at its speed."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.onboard.pose.simulated_approach import default_setup, fly


def test_it_begins_on_the_glide_path_at_its_speed(rng: np.random.Generator) -> None:
    setup = replace(default_setup(), duration_s=0.2)
    flown = fly(setup, rng)
    glide = np.radians(setup.glide_deg)
    assert flown.velocity_m_s[0] == pytest.approx(setup.speed_m_s * np.array([0.0, -np.cos(glide), -np.sin(glide)]))
    assert flown.position_m[0] == pytest.approx([0.0, setup.from_m, setup.from_m * np.tan(glide)])
