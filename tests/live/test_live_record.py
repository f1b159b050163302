"""A live recording contains its run's settings, as a replay needs them."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from groundstation.conversion.recording_header import build_header
from groundstation.live.record import live_header, live_reference, open_recorder
from groundstation.live.reference_device import ReferenceDevice
from groundstation.live.reference_set_up import reference_tuning
from groundstation.live.set_up_report import report_set_up
from groundstation.live.station_file import StationFile
from groundstation.messages import Epoch, ReferenceFix
from groundstation.recording.mcap_reader import McapReader
from groundstation.replay.recorded_references import learning_references
from groundstation.replay.recording_replay import load_replay_config
from groundstation.replay.reference_prior import reference_prior
from groundstation.replay.replay_inputs import load_inputs
from groundstation.replay.replay_request import ReplayRequest
from groundstation.rig.dgps import RigReference
from groundstation.rig.rig import load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.simulation.simulated_station_file import simulated_station_file
from groundstation.sources.session_source import session_source
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


def with_named_clock(folder: Path, session: str) -> StationFile:
    """A station whose rig knows the clock of one session, to 2 ms, and whose file states the receiver's to 0.1 s."""
    file = simulated_station_file(folder, 30.0, None, dgps=True)
    named = RigReference(session=session, offset_s=0.08, offset_sigma_s=0.002)
    file.rig.write_text(rig_to_toml(replace(load_rig(file.rig), reference=named)))
    return replace(file, reference=ReferenceDevice(url="udp://:5000", clock_offset_s=0.0, clock_sigma_s=0.1))


def test_the_clock_of_a_named_session_is_that_of_no_operation(tmp_path: Path) -> None:
    """All recordings of a station have its name: the flight calibrated was one of them, this one is another."""
    file = with_named_clock(tmp_path, simulated_station_file(tmp_path, 30.0, None).name)
    rig, config = load_rig(file.rig), reference_tuning(load_config(None), file.reference)
    header = live_header(file, config)
    known = live_reference(header, rig, config)
    assert known.offset_s == 0.0
    np.testing.assert_allclose(known.errors.covariance[0, 0], 0.1**2)
    said: list[str] = []
    logged: list[tuple[str, str]] = []
    report_set_up(replace(file, sun_angle_rad=0.0), rig, known, lambda *line: logged.append(line), said.append)
    assert len(said) == 1
    assert said[0].startswith(f"DGPS clock by the rig: not used, +0.080 s is of session {file.name!r}")
    assert ("info", said[0]) in logged
    without = replace(file, reference=None, sun_angle_rad=0.0)
    said.clear()
    report_set_up(without, rig, known, lambda *line: None, said.append)
    assert not said
    path = tmp_path / "flight.mcap"
    with open_recorder(path, rig, header) as recorder:
        recorder.take(Epoch(t_s=1.0, epoch=0, stations=rig.names))
    again = reference_prior(load_session(path), config.estimation)
    assert (again.offset_s, again.notes) == (0.0, known.notes)


def test_recordings_of_one_station_are_told_apart_by_their_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock that a calibration finds in one of them is used in its replay, and not in the next one's."""
    file = with_named_clock(tmp_path, "nothing")
    rig, config = load_rig(file.rig), load_config(None)
    sessions = []
    for second in (1, 2):
        start = datetime(2026, 5, 17, 9, 30, second, tzinfo=UTC)
        monkeypatch.setattr("groundstation.live.record._utc_now", lambda start=start: start)
        path = tmp_path / f"{second}.mcap"
        with open_recorder(path, rig, live_header(file, config)) as recorder:
            recorder.take(Epoch(t_s=1.0, epoch=0, stations=rig.names))
        sessions.append(load_session(path))
    first, other = sessions
    assert first.name == other.name == file.name
    assert first.identity == f"{file.name} 2026-05-17T09:30:01+00:00"
    found = replace(rig, reference=RigReference(session=first.identity, offset_s=0.08, offset_sigma_s=0.002))
    offsets = [reference_prior(replace(s, rig=found), config.estimation).offset_s for s in sessions]
    assert offsets == [0.08, 0.0]


SENT_S = [1.0 + 0.1 * k for k in range(20)]


def recorded_fixes(folder: Path, *, clock_by_identity: bool) -> Path:
    """Record positions of a receiver, as a station whose rig names the clock of its name does."""
    file = with_named_clock(folder, simulated_station_file(folder, 30.0, None).name)
    rig, config = load_rig(file.rig), reference_tuning(load_config(None), file.reference)
    header = replace(live_header(file, config), clock_by_identity=clock_by_identity)
    path = folder / "flight.mcap"
    with open_recorder(path, rig, header) as recorder:
        for k, t_s in enumerate(SENT_S):
            position_m = np.array([0.0, 800.0 - 40.0 * t_s, 20.0])
            recorder.take(ReferenceFix(t_s=t_s, position_runway_m=position_m, sigma_m=np.full(3, 0.02)))
            recorder.take(Epoch(t_s=t_s + 0.01, epoch=k, stations=rig.names))
    return path


def replayed_times(path: Path, rig: Path | None = None) -> tuple[float, list[float]]:
    """Return the clock that a replay begins with, and the times of the positions that it learns from."""
    request = ReplayRequest(session=path, out=path.parent / "out", rig=rig)
    inputs = load_inputs(request)
    with session_source(inputs.session, reference=learning_references(request, inputs).in_place) as source:
        return inputs.prior.offset_s, [event.t_s for event in source if isinstance(event, ReferenceFix)]


def test_a_clock_that_an_earlier_run_took_by_name_is_not_taken_twice(tmp_path: Path) -> None:
    """Expected: replayed with it, as flown; by a rig that names the run, that one's clock instead, not on top of it."""
    path = recorded_fixes(tmp_path, clock_by_identity=False)
    assert replayed_times(path) == (0.08, SENT_S)
    session = load_session(path)
    # a replay's own recording of it is of the same events, or of those by another rig
    for rig in (None, tmp_path / "any.toml"):
        (tmp_path / "any.toml").write_text(rig_to_toml(session.rig))
        again = build_header(session, rig, Config(), initial=None, learns_from_reference=True)
        assert again.clock_by_identity is (rig is not None)
    for name, offset_s in (("same", 0.08), ("other", 0.05), ("none", None)):
        known = RigReference(session=session.identity, offset_s=offset_s, offset_sigma_s=0.002)
        (tmp_path / f"{name}.toml").write_text(rig_to_toml(replace(session.rig, reference=known)))
    assert replayed_times(path, tmp_path / "same.toml") == (0.08, SENT_S)
    by_other, by_none = (replayed_times(path, tmp_path / f"{name}.toml") for name in ("other", "none"))
    assert (by_other[0], by_none[0]) == (0.05, 0.0)
    np.testing.assert_allclose(by_other[1], np.array(SENT_S) + 0.03, atol=1e-12)
    np.testing.assert_allclose(by_none[1], np.array(SENT_S) + 0.08, atol=1e-12)


def test_a_recording_says_that_its_clock_is_by_identity(tmp_path: Path) -> None:
    """Expected: of a run that did not use the named clock, a rig that names the run corrects the times received."""
    path = recorded_fixes(tmp_path, clock_by_identity=True)
    with McapReader(path) as reader:
        assert reader.contents().metadata["groundstation"]["clock_by_identity"] == "true"
    assert replayed_times(path) == (0.0, SENT_S)
    session = load_session(path)
    known = RigReference(session=session.identity, offset_s=0.08, offset_sigma_s=0.002)
    (tmp_path / "named.toml").write_text(rig_to_toml(replace(session.rig, reference=known)))
    offset_s, times_s = replayed_times(path, tmp_path / "named.toml")
    assert offset_s == 0.08
    np.testing.assert_allclose(times_s, np.array(SENT_S) - 0.08, atol=1e-12)


def test_a_clock_that_is_no_sessions_is_used_and_said(tmp_path: Path) -> None:
    file = with_named_clock(tmp_path, "")
    rig, config = load_rig(file.rig), load_config(None)
    known = live_reference(live_header(file, config), rig, config)
    assert known.offset_s == 0.08
    said: list[str] = []
    report_set_up(replace(file, sun_angle_rad=0.0), rig, known, lambda *line: None, said.append)
    assert said == ["DGPS clock by the rig: +0.080 s ± 2.0 ms to begin with"]
