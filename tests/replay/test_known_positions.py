"""A reference tells where the aircraft was while there were pictures."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from groundstation.replay.replay_inputs import known_positions, load_inputs
from groundstation.replay.replay_request import ReplayRequest

SESSION = Path(__file__).resolve().parents[2] / "recordings" / "landing-1"


def test_what_no_camera_filmed_is_left_out(tmp_path: Path) -> None:
    """Expected: of truth and of a log of the whole flight the part within the pictures' span, or nothing.

    Fixed cameras look at one place: half an hour of flight elsewhere would say that they look past the aircraft.
    """
    inputs = load_inputs(ReplayRequest(session=SESSION, out=tmp_path / "out"))
    assert inputs.truth is not None
    first_s, last_s = float(inputs.truth.t_s[0]), float(inputs.truth.t_s[-1])
    span_s = (first_s + 1.0, first_s + 3.0)
    for name, of in (("truth.csv", inputs), ("the DGPS log", replace(inputs, truth=None))):
        (known,) = known_positions(of, span_s)
        assert known.name == name
        assert span_s[0] <= known.t_s[0] < known.t_s[-1] <= span_s[1]
        assert known.position_m.shape == (len(known.t_s), 3)
        assert np.isfinite(known.position_m).all()
        assert known_positions(of, (last_s + 600.0, last_s + 620.0)) == []
    assert known_positions(replace(inputs, truth=None, dgps=()), span_s) == []
