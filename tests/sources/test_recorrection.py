"""A recording replayed with another rig: its stamps and readings are corrected by that one's clocks and axes."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import RigError
from groundstation.messages import Epoch, Event, Frame, PixelMeasurement, PtuSample
from groundstation.recording.mcap_metadata import RecordingHeader
from groundstation.recording.recorder import Recorder
from groundstation.replay.replay_inputs import load_inputs
from groundstation.replay.replay_request import ReplayRequest
from groundstation.rig.ptu_axes import AxisCorrection, PtuAxes
from groundstation.rig.rig import EQUAL_CLOCKS, ClockModel, Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.sources.recording_source import RecordingSource
from groundstation.sources.recorrection import Recorrection
from tests.recording.recorded import FILES, STATIONS, small_rig
from tests.session.folder import SESSION

DEG = math.radians(1.0)
AXES = PtuAxes(pan_zero_rad=0.5 * DEG, tilt_zero_rad=-0.2 * DEG, pan_scale=5e-3, pan_sine_rad=0.05 * DEG)
OTHER_AXES = replace(AXES, pan_zero_rad=-0.4 * DEG, tilt_scale=1e-3, pan_backlash_rad=0.1 * DEG)


def rig_with(axes: PtuAxes, ptu_s: float, camera_s: float) -> Rig:
    rig = small_rig()
    left = replace(
        rig["left"],
        ptu_axes=axes,
        ptu_clock=ClockModel(offset_s=ptu_s),
        ptu_clock_given=True,
        camera_clock=ClockModel(offset_s=camera_s),
    )
    return replace(rig, stations=(left, *rig.stations[1:]))


def session_events(rig: Rig) -> list[Event]:
    """Return the same readings and pixels of a device as a rig corrects them."""
    random = np.random.default_rng(3)
    axes = {s.name: AxisCorrection(s.ptu_axes) for s in rig.stations}
    ptus = {s.name: s.ptu_clock for s in rig.stations}
    cameras = {s.name: s.camera_clock or EQUAL_CLOCKS for s in rig.stations}
    found: list[Event] = []
    for k in range(20):
        t_s, stamps = 100.0 + k / 30.0, []
        for name in STATIONS:
            pan, tilt = random.normal(0.0, 0.2, 2).tolist()
            pan_rad, tilt_rad = axes[name].angles(pan, tilt)
            read_s = ptus[name].session_from_device(t_s - 1e-3)
            found.append(PtuSample(t_s=read_s, station=name, pan_rad=pan_rad, tilt_rad=tilt_rad))
            stamps.append(cameras[name].session_from_device(t_s))
            found.append(PixelMeasurement(t_s=stamps[-1], station=name, epoch=k, u_px=10.0 + k, v_px=20.0))
        found.append(Epoch(t_s=sum(stamps) / len(stamps), epoch=k, stations=STATIONS))
    return found


def recorded(folder: Path, rig: Rig, events: list[Event] | None = None, *, corrected: bool = True) -> Path:
    note = "" if corrected else "# recorded in operation\n"
    files = {**FILES, "session.toml": (note + SESSION).encode(), "rig.toml": rig_to_toml(rig).encode()}
    path = folder / "flight.mcap"
    header = RecordingHeader(name="tiny", files=files, pictures=False, corrected=corrected)
    with Recorder(path, rig, header) as recorder:
        for event in session_events(rig) if events is None else events:
            recorder.take(event)
    return path


def replayed(path: Path, rig: Path | None = None) -> list[Event]:
    session = load_session(path, rig)
    assert session.recorded is not None
    with RecordingSource(session, session.recorded) as source:
        return list(source)


def test_the_recorded_rig_changes_no_bit(tmp_path: Path) -> None:
    rig = rig_with(replace(AXES, pan_backlash_rad=0.1 * DEG), -0.037, 0.012)
    path = recorded(tmp_path, rig)
    (tmp_path / "same.toml").write_text(rig_to_toml(rig))
    assert replayed(path) == session_events(rig)
    assert replayed(path, tmp_path / "same.toml") == session_events(rig)


def test_another_rig_corrects_the_same_readings(tmp_path: Path) -> None:
    """Expected: the events that the devices' own readings would have made with that rig, to rounding."""
    path, other = recorded(tmp_path, rig_with(AXES, -0.037, 0.012)), rig_with(OTHER_AXES, 0.02, -0.03)
    (tmp_path / "other.toml").write_text(rig_to_toml(other))
    wanted, found = session_events(other), replayed(path, tmp_path / "other.toml")
    assert [type(event) for event in found] == [type(event) for event in wanted]
    for one, two in zip(found, wanted, strict=True):
        assert one.t_s == pytest.approx(two.t_s, abs=1e-9)
        if isinstance(one, PtuSample):
            assert isinstance(two, PtuSample)
            assert one.station == two.station
            assert (one.pan_rad, one.tilt_rad) == pytest.approx((two.pan_rad, two.tilt_rad), abs=1e-9)


def test_a_backlash_that_was_taken_out_is_not_known_any_more() -> None:
    own, other = rig_with(OTHER_AXES, 0.0, 0.0), rig_with(AXES, 0.0, 0.0)
    with pytest.raises(
        RigError, match=r"left: ptu_axes: got other axes .* backlash has been taken out; wanted the rec"
    ):
        Recorrection(own, replace(other, path="other.toml"))
    assert not Recorrection(own, own).is_needed


def test_an_early_recording_of_operation_has_readings(tmp_path: Path) -> None:
    """Expected: replayed as it was flown, and with the same rig as --rig corrected for the first time."""
    rig = rig_with(AXES, -0.037, 0.012)
    readings = session_events(small_rig())
    path = recorded(tmp_path, rig, readings, corrected=False)
    (tmp_path / "same.toml").write_text(rig_to_toml(rig))
    assert replayed(path) == readings
    for one, two in zip(replayed(path, tmp_path / "same.toml"), session_events(rig), strict=True):
        assert one.t_s == pytest.approx(two.t_s, abs=1e-9)
        if isinstance(one, PtuSample):
            assert isinstance(two, PtuSample)
            assert (one.pan_rad, one.tilt_rad) == pytest.approx((two.pan_rad, two.tilt_rad), abs=1e-9)


def test_a_rig_without_axes_is_that_of_angles_whose_readings_are_hidden() -> None:
    """Expected: what `convert` writes next to angles of corrected backlash, laid over the recording, moves none."""
    assert not Recorrection(rig_with(OTHER_AXES, 0.0, 0.0), rig_with(PtuAxes(), 0.0, 0.0)).is_needed


def test_a_rig_without_axes_takes_known_readings_for_angles(tmp_path: Path) -> None:
    """Expected: as it does the readings of the folder converted from the recording; a replay notes it."""
    bare = tmp_path / "bare.toml"
    bare.write_text(rig_to_toml(rig_with(PtuAxes(), 0.0, 0.0)))
    path = recorded(tmp_path, rig_with(AXES, 0.0, 0.0))
    for one, two in zip(replayed(path, bare), session_events(rig_with(PtuAxes(), 0.0, 0.0)), strict=True):
        if isinstance(one, PtuSample):
            assert isinstance(two, PtuSample)
            assert (one.pan_rad, one.tilt_rad) == pytest.approx((two.pan_rad, two.tilt_rad), abs=1e-9)
    said = [load_inputs(ReplayRequest(session=path, out=tmp_path / "out", rig=rig)).notes for rig in (None, bare)]
    words = "the rig has no ptu_axes of left, the recording's has: the devices' readings are used as angles"
    assert [any(note.startswith(words) for note in notes) for notes in said] == [False, True]


def test_angles_of_pictures_and_stations_without_a_difference_stay() -> None:
    """Expected: what a picture told has no reading to be corrected; its time is the picture's."""
    change = Recorrection(rig_with(AXES, 0.0, 0.0), rig_with(OTHER_AXES, 0.1, 0.25))
    seen = PtuSample(t_s=1.0, station="left", pan_rad=0.1, tilt_rad=0.2, sigma_rad=1e-4)
    right = PtuSample(t_s=1.0, station="right", pan_rad=0.1, tilt_rad=0.2)
    found = list(change.of(iter([seen, right])))
    assert found == [replace(seen, t_s=1.25), right]
    assert not any(isinstance(event, Frame) for event in found)
