"""Which flight is drawn for a scene and a seed."""

import pytest

pytest.importorskip("jsbsim")

from groundstation.onboard.render import drawn_flight
from groundstation.onboard.scenes import jsbsim_flight
from groundstation.onboard.scenes.sequences import SEQUENCES


def test_the_flight_models_flight_fits_the_scene_and_the_requested_length(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jsbsim_flight, "jsbsim_nose_flight", lambda sequence, setup: (sequence, setup))
    sequence, setup = drawn_flight(1, 3, frames=60, motion="jsbsim")
    assert sequence.seed == SEQUENCES[1].seed + 30_000
    assert setup.duration_s == pytest.approx(60 / setup.camera_hz)
