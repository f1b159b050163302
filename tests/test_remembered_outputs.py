"""What a network has given is handed out again for the same input alone, and it gives the same bits where it is run."""

from unittest.mock import patch

import numpy as np
import pytest
from onnxruntime import InferenceSession

from groundstation.detection.channel_window import WINDOW_PX
from groundstation.files.channel_weights import channel_weights
from tests import remembered_outputs
from tests.remembered_outputs import nothing_remembered

SHAPE = (1, 3, WINDOW_PX[1], WINDOW_PX[0])


@pytest.fixture(scope="module")
def network() -> InferenceSession:
    return InferenceSession(channel_weights(), providers=["CPUExecutionProvider"])


def run(network: InferenceSession, window: np.ndarray) -> np.ndarray:
    (output,) = network.run(None, {network.get_inputs()[0].name: window})
    return np.asarray(output)


def test_the_same_input_is_run_once_and_another_by_one_level_again(
    network: InferenceSession, rng: np.random.Generator
) -> None:
    window = rng.integers(0, 256, SHAPE).astype(np.float32)
    other = window.copy()
    other[0, 2, -1, -1] += 1.0
    with patch.object(remembered_outputs, "_run", wraps=remembered_outputs._run) as ran:
        first = run(network, window)
        # the caller's own: what is done to it changes nothing
        kept = first.copy()
        first[:] = 0.0
        assert run(network, window).tobytes() == kept.tobytes()
        assert ran.call_count == 1
        assert run(network, other).tobytes() != kept.tobytes()
        assert ran.call_count == 2
    second = InferenceSession(channel_weights(), providers=["CPUExecutionProvider"])
    with patch.object(remembered_outputs, "_run", wraps=remembered_outputs._run) as ran:
        assert run(second, window).tobytes() == kept.tobytes()
        assert ran.call_count == 1


def test_a_network_gives_the_same_bits_each_time_that_it_is_run(
    network: InferenceSession, rng: np.random.Generator
) -> None:
    windows = [rng.integers(0, 256, SHAPE).astype(np.float32) for _ in range(3)]
    with nothing_remembered():
        given = [[run(network, window).tobytes() for window in windows] for _ in range(3)]
        other = InferenceSession(channel_weights(), providers=["CPUExecutionProvider"])
        given.append([run(other, window).tobytes() for window in windows])
    assert all(each == given[0] for each in given)
    assert [run(network, window).tobytes() for window in windows] == given[0]


def test_the_oldest_is_left_out(
    network: InferenceSession, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remembered_outputs, "MOST", 2)
    fresh = InferenceSession(channel_weights(), providers=["CPUExecutionProvider"])
    a, b, c = (rng.integers(0, 256, SHAPE).astype(np.float32) for _ in range(3))
    with patch.object(remembered_outputs, "_run", wraps=remembered_outputs._run) as ran:
        for window in (a, b, a, c):
            run(fresh, window)
        assert ran.call_count == 3
        run(fresh, a)
        assert ran.call_count == 3
        run(fresh, b)
        assert ran.call_count == 4
