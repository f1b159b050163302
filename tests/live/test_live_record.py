"""A live recording says how its run was set up, as a replay needs it."""

from pathlib import Path

from groundstation.config import Config, load_config
from groundstation.live.record import open_recorder
from groundstation.live.simulated_day import simulated_set_up
from groundstation.messages import Epoch
from groundstation.recorded_run import tuning
from groundstation.rig import load_rig
from groundstation.rig_toml import rig_to_toml
from groundstation.session import load_session


def test_what_a_replay_needs_is_in_it(tmp_path: Path) -> None:
    file = simulated_set_up(tmp_path, 30.0, None)
    rig, config = load_rig(file.rig), load_config(file.config)
    path = tmp_path / "flight.mcap"
    with open_recorder(path, file, rig, config) as recorder:
        recorder.take(Epoch(t_s=1.0, epoch=0, stations=rig.names))
        assert recorder.words().startswith("recording")
    assert recorder.words().startswith("closed")
    session = load_session(path)
    assert (session.name, session.target.span_m) == (file.name, file.span_m)
    assert rig_to_toml(session.rig) == rig_to_toml(rig)
    assert tuning(session, None) == config == Config()
    assert session.recorded is not None
    assert (session.recorded.epochs, session.recorded.header.initial) == (1, None)
