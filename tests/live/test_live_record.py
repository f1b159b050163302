"""A live recording contains its run's settings, as a replay needs them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from groundstation.live.record import live_header, live_reference, open_recorder
from groundstation.live.reference_device import ReferenceDevice
from groundstation.live.reference_set_up import reference_tuning
from groundstation.messages import Epoch
from groundstation.replay.recording_replay import load_replay_config
from groundstation.replay.reference_prior import reference_prior
from groundstation.rig.rig import load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.simulation.simulated_station_file import simulated_station_file
from groundstation.tracking.config import Config, load_config


def test_what_a_replay_needs_is_in_it(tmp_path: Path) -> None:
    file = simulated_station_file(tmp_path, 30.0, None)
    rig, config = load_rig(file.rig), load_config(file.config)
    path = tmp_path / "flight.mcap"
    with open_recorder(path, rig, live_header(file, config)) as recorder:
        recorder.take(Epoch(t_s=1.0, epoch=0, stations=rig.names))
        assert recorder.summary().startswith("recording")
    assert recorder.summary().startswith("closed")
    session = load_session(path)
    assert (session.name, session.target.span_m) == (file.name, file.span_m)
    assert rig_to_toml(session.rig) == rig_to_toml(rig)
    assert load_replay_config(session, None) == config == Config()
    assert session.recorded is not None
    assert (session.recorded.epochs, session.recorded.header.initial) == (1, None)


def test_the_receivers_parameters_equal_those_of_a_replay(tmp_path: Path) -> None:
    file = replace(
        simulated_station_file(tmp_path, 30.0, None, dgps=True),
        antenna_in_body_m=(-0.8, 0.1, -0.15),
        reference=ReferenceDevice(url="udp://:5000", clock_sigma_s=0.02),
    )
    rig, config = load_rig(file.rig), reference_tuning(load_config(None), file.reference)
    header = live_header(file, config)
    known = live_reference(header, rig, config)
    path = tmp_path / "flight.mcap"
    with open_recorder(path, rig, header) as recorder:
        recorder.take(Epoch(t_s=1.0, epoch=0, stations=rig.names))
    session = load_session(path)
    assert session.recorded is not None
    assert session.recorded.header.learns_from_reference
    again = reference_prior(session, load_replay_config(session, None).estimation)
    assert (again.errors.names, again.offset_s) == (known.errors.names, known.offset_s)
    np.testing.assert_array_equal(again.errors.covariance, known.errors.covariance)
    np.testing.assert_array_equal(known.errors.covariance, [[0.02**2]])
    np.testing.assert_array_equal(again.antenna_in_body_m, [-0.8, 0.1, -0.15])
    assert session.origin == file.origin
