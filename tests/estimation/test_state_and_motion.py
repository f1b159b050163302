"""The state's slices tile it; the motion model is consistent at any step length."""

import numpy as np
import pytest

from groundstation.estimation.motion import MotionModel
from groundstation.estimation.state_model import state_layout


@pytest.mark.parametrize("names", [(), ("left",), ("left", "right"), ("a", "b", "c", "d")])
def test_slices_tile_the_state(names: tuple[str, ...]) -> None:
    layout = state_layout(names)
    taken = [layout.position, layout.velocity, *layout.angles.values(), *layout.rates.values()]
    numbers = sorted(i for s in taken for i in range(s.start, s.stop))
    assert numbers == list(range(layout.size))
    assert layout.size == 6 + 4 * len(names)


def test_two_stations_make_the_papers_fourteen_states() -> None:
    assert state_layout(("left", "right")).size == 14


def test_two_short_steps_are_one_long_step() -> None:
    """White-acceleration noise does not depend on how the time is cut: F Q Fᵀ + Q composes."""
    layout = state_layout(("left", "right"))
    model = MotionModel(layout, (0.3, 0.6, 0.2), 1e-3)
    F1, Q1 = model.transition(0.07), model.process_noise(0.07)
    F2, Q2 = model.transition(0.03), model.process_noise(0.03)
    np.testing.assert_allclose(F2 @ F1, model.transition(0.1), atol=1e-15)
    np.testing.assert_allclose(F2 @ Q1 @ F2.T + Q2, model.process_noise(0.1), rtol=1e-12, atol=1e-18)


def test_process_noise_is_a_covariance_in_both_directions_of_time() -> None:
    model = MotionModel(state_layout(("left",)), (0.3, 0.6, 0.2), 1e-3)
    for dt in (1e-4, 0.1, 5.0, -0.01):
        assert np.linalg.eigvalsh(model.process_noise(dt)).min() > -1e-15
