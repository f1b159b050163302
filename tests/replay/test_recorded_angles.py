"""Angles from pictures in a replay's recording, and in all that a recording is converted to."""

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.conversion.ros_bag_writer import RosBagWriter
from groundstation.errors import SessionError
from groundstation.messages import CameraReport, Event, FrameAngles
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.sources.panorama_file import read_panoramas, write_panoramas
from groundstation.sources.session_source import session_source
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.registered_heads import RegisteredHeads
from tests.calibration.panorama.test_panorama import NOISE_RAD, frame, mosaic, station
from tests.live.test_registered_angles import PAIRS, RATE_HZ, TRUE_DEG, rig


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a session of drawn ground, the left head's panorama, and a replay's recording with it."""
    folder, random = tmp_path_factory.mktemp("flight"), np.random.default_rng(22)
    session = folder / "session"
    session.mkdir()
    (session / "session.toml").write_text('name = "ground"\n')
    (session / "rig.toml").write_text(rig_to_toml(rig()))
    stamps = [1.0 + k / RATE_HZ for k in range(PAIRS)]
    names = rig().names
    rows = [f"{k}," + ",".join(f"{t + 0.001 * n!r}" for n in range(len(names))) for k, t in enumerate(stamps)]
    header = "index," + ",".join(f"{n}_t_s" for n in names)
    (session / "frames.csv").write_text("\n".join([header, *rows]) + "\n")
    header = "t_s," + ",".join(f"{n}_{axis}_deg" for n in names for axis in ("pan", "tilt"))
    rows = []
    for k in range(-1, 2 * PAIRS + 2):
        off = random.normal(0.0, 0.7 * np.degrees(NOISE_RAD), 2 * len(names))
        rows.append(
            f"{1.0 + k / (2 * RATE_HZ) + 0.004!r}," + ",".join(map(repr, (np.array(TRUE_DEG * 2) + off).tolist()))
        )
    (session / "ptu.csv").write_text("\n".join([header, *rows]) + "\n")
    for name in names:
        (session / name).mkdir()
        for k in range(PAIRS):
            grey = np.repeat(np.repeat(frame(*TRUE_DEG, random).astype(np.uint8), 2, axis=0), 2, axis=1)
            assert cv2.imwrite(str(session / name / f"{k:06d}.png"), np.repeat(grey[:, :, None], 3, axis=2))
    write_panoramas(folder / "p.npz", {station().name: mosaic().panorama})
    record = ["--panorama", str(folder / "p.npz"), "--record", str(folder / "flight.mcap")]
    assert main(["replay", str(session), "--out", str(folder / "first"), "--no-rerun", *record]) == 0
    return folder


def streamed(path: Path) -> list[Event]:
    with session_source(load_session(path)) as source:
        return list(source)


def angles(path: Path) -> list[FrameAngles]:
    return [event for event in streamed(path) if isinstance(event, FrameAngles)]


def cameras(events: list[Event], heads: RegisteredHeads | None) -> list[CameraReport]:
    pipeline = Pipeline(rig(), Config(), heads=heads)
    return [c for report in (*map(pipeline.step, events), pipeline.finish()) for c in report.cameras]


def test_a_replay_of_a_replay_s_recording_has_the_angles_of_the_pictures(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: each frame's pan and tilt, bit for bit, without the panorama."""
    found = angles(flight / "flight.mcap")
    assert [event.station for event in found] == [station().name] * PAIRS
    heads = RegisteredHeads(rig(), read_panoramas(flight / "p.npz"))
    first = cameras(streamed(flight / "session"), heads)
    again = cameras(streamed(flight / "flight.mcap"), None)
    assert [(c.station, c.t_s, c.pan_rad, c.tilt_rad) for c in first] == [
        (c.station, c.t_s, c.pan_rad, c.tilt_rad) for c in again
    ]
    own = [np.degrees(c.pan_rad or 0.0) for c in again if c.station == station().name]
    assert own == pytest.approx([TRUE_DEG[0]] * PAIRS, abs=0.05)
    capsys.readouterr()
    assert main(["replay", str(flight / "flight.mcap"), "--out", str(tmp_path / "again"), "--no-rerun"]) == 0
    assert f"head angles of {station().name} in {PAIRS} frames from the recording" in capsys.readouterr().out


def test_a_recording_of_recorded_angles_has_those_that_were_used(flight: Path, tmp_path: Path) -> None:
    """Expected: those of a panorama of the other head, those of the recording for the first, each once."""
    second, panorama = tmp_path / "second.mcap", tmp_path / "other.npz"
    write_panoramas(panorama, {"other": mosaic().panorama})
    record = ["--panorama", str(panorama), "--record", str(second)]
    arguments = ["replay", str(flight / "flight.mcap"), "--out", str(tmp_path / "out"), "--no-rerun", *record]
    assert main(arguments) == 0
    assert sorted(event.station for event in angles(second)) == sorted([station().name, "other"] * PAIRS)
    heads = RegisteredHeads(rig(), read_panoramas(panorama))
    first, again = cameras(streamed(flight / "flight.mcap"), heads), cameras(streamed(second), None)
    assert [(c.pan_rad, c.tilt_rad) for c in first] == [(c.pan_rad, c.tilt_rad) for c in again]


def test_a_folder_and_its_recording_keep_the_angles(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: bit for bit in a table of its own, there and back, and a replay of the folder uses them."""
    given = angles(flight / "flight.mcap")
    assert main(["convert", str(flight / "flight.mcap"), str(tmp_path / "folder")]) == 0
    table = (tmp_path / "folder" / "frame_angles.csv").read_text().splitlines()
    assert table[0] == "t_s,station,pan_rad,tilt_rad,sigma_rad"
    assert len(table) == 1 + PAIRS
    assert angles(tmp_path / "folder") == given
    assert main(["convert", str(tmp_path / "folder"), str(tmp_path / "back.mcap")]) == 0
    assert angles(tmp_path / "back.mcap") == given
    capsys.readouterr()
    assert main(["replay", str(tmp_path / "folder"), "--out", str(tmp_path / "out"), "--no-rerun"]) == 0
    assert f"head angles of {station().name} in {PAIRS} frames from the recording" in capsys.readouterr().out


def test_a_ros_bag_keeps_the_angles(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rosbags")
    given = angles(flight / "flight.mcap")
    assert main(["convert", str(flight / "flight.mcap"), str(tmp_path / "bag"), "--ros2"]) == 0
    assert main(["convert", str(tmp_path / "bag"), str(tmp_path / "back")]) == 0
    back = angles(tmp_path / "back")
    assert [event.station for event in back] == [event.station for event in given]
    for one, two in zip(given, back, strict=True):
        assert one.t_s == pytest.approx(two.t_s, abs=2e-9)
        assert (one.pan_rad, one.tilt_rad, one.sigma_rad) == pytest.approx(
            (two.pan_rad, two.tilt_rad, two.sigma_rad), abs=1e-15
        )


def test_angles_of_a_rolling_shutter_keep_their_instant(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: bit for bit through table and recording; a ROS bag has no place for it, and says so."""
    pytest.importorskip("rosbags")
    assert main(["convert", str(flight / "flight.mcap"), str(tmp_path / "folder")]) == 0
    table = tmp_path / "folder" / "frame_angles.csv"
    header, *rows = table.read_text().splitlines()
    delays = [0.001 * k / 3.0 - 0.001 for k in range(len(rows))]
    rows = [f"{row},{delay!r}" for row, delay in zip(rows, delays, strict=True)]
    table.write_text("\n".join([f"{header},delay_s", *rows]) + "\n")
    given = angles(tmp_path / "folder")
    assert [event.delay_s for event in given] == delays
    assert main(["convert", str(tmp_path / "folder"), str(tmp_path / "back.mcap")]) == 0
    assert angles(tmp_path / "back.mcap") == given
    assert main(["convert", str(tmp_path / "back.mcap"), str(tmp_path / "again")]) == 0
    assert angles(tmp_path / "again") == given
    capsys.readouterr()
    assert main(["convert", str(tmp_path / "back.mcap"), str(tmp_path / "bag"), "--ros2"]) == 0
    assert f"{PAIRS - delays.count(0.0)} angles from pictures of a rolling shutter" in capsys.readouterr().out
    table.write_text("\n".join([f"{header},delay_s", f"{rows[0].rpartition(',')[0]},3.0", *rows[1:]]) + "\n")
    with pytest.raises(SessionError, match=r"line 2: got delay_s = 3; wanted seconds, at most 1 either way"):
        angles(tmp_path / "folder")


@pytest.mark.parametrize("bad", [{"sigma_rad": 0.0}, {"sigma_rad": math.nan}, {"pan_rad": math.inf}])
def test_what_is_no_angle_in_a_ros_bag_is_passed_over(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bad: dict[str, float]
) -> None:
    """Expected: the others are there, and the folder can be read."""
    pytest.importorskip("rosbags")
    given, take = angles(flight / "flight.mcap"), RosBagWriter.take

    def spoiled(writer: RosBagWriter, event: Event) -> None:
        wrong = isinstance(event, FrameAngles) and event == given[2]
        take(writer, replace(event, **bad) if wrong else event)

    monkeypatch.setattr(RosBagWriter, "take", spoiled)
    assert main(["convert", str(flight / "flight.mcap"), str(tmp_path / "bag"), "--ros2"]) == 0
    assert main(["convert", str(tmp_path / "bag"), str(tmp_path / "back")]) == 0
    assert len(angles(tmp_path / "back")) == len(given) - 1


def test_a_fault_in_the_table_is_told_with_its_line(flight: Path, tmp_path: Path) -> None:
    """Expected: the frames are all there, and what is wrong is raised in the end."""
    folder = tmp_path / "folder"
    assert main(["convert", str(flight / "flight.mcap"), str(folder)]) == 0
    rows = (folder / "frame_angles.csv").read_text().splitlines()
    for row, said in (("1.0,left,1.0,2.0,0.0", "sigma_rad = 0"), ("1.0,third,1.0,2.0,0.1", "station 'third'")):
        (folder / "frame_angles.csv").write_text("\n".join([*rows[:3], row, *rows[3:]]) + "\n")
        events: list[Event] = []
        with session_source(load_session(folder)) as source, pytest.raises(SessionError, match="line 4: got") as fault:
            events.extend(source)
        assert "frame_angles.csv" in str(fault.value)
        assert said in str(fault.value)
