"""Folders into recordings and back; the commands as a user meets them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.conversion.recording_header import build_header
from groundstation.messages import Event, Frame, Heartbeat, PtuSample
from groundstation.recording.recorder import PATIENT, Recorder, RecorderConfig
from groundstation.session import load_session
from groundstation.sources.session_source import session_source
from groundstation.tracking.config import Config
from tests.files.limits import files_of_at_most
from tests.recording.recorded import WINDOW, events, header, looked_at, small_rig
from tests.session.folder import Tiny

pytestmark = pytest.mark.usefixtures("unrendered_figures")

CLOCKS = {
    "left": "camera_clock = { offset_s = 0.0137, drift_ppm = 21.0 }\nptu_clock = { offset_s = -0.003, drift_ppm = 3.0 }"
}


def streamed(path: Path) -> list[Event]:
    with session_source(load_session(path)) as source:
        return list(source)


def same_whole(one: Event, other: Event) -> bool:
    if isinstance(one, Frame) and isinstance(other, Frame):
        heads = (one.t_s, one.station, one.epoch) == (other.t_s, other.station, other.epoch)
        return heads and np.array_equal(one.image.whole(), other.image.whole())
    return one == other


def test_there_and_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stamps = {"left": [1.0, None, *(1.2 + 0.1 * k for k in range(6))]}
    folder = Tiny(rows=8, video="png", rig_more=CLOCKS, stamps=stamps)
    first = folder.write(tmp_path / "first")
    (first / "dgps.csv").write_text("t_s,x_m,y_m,z_m\n1.0,0,300,20\n1.1,0,299,20\n")
    packed, second = tmp_path / "packed.mcap", tmp_path / "second"
    assert main(["convert", str(first), str(packed)]) == 0
    assert main(["convert", str(packed), str(second)]) == 0
    assert "note" not in capsys.readouterr().out
    given = streamed(first)
    assert len(given) > 30
    for other in (packed, second):
        back = streamed(other)
        assert all(same_whole(one, two) for one, two in zip(given, back, strict=True))
    for name in ("session.toml", "rig.toml", "dgps.csv"):
        assert (second / name).read_bytes() == (first / name).read_bytes()


def test_a_full_disk_leaves_no_recording_and_none_is_called_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("groundstation.recording.recorder._free_bytes", lambda _: 0)
    packed = tmp_path / "packed.mcap"
    assert main(["convert", str(Tiny(rows=8, video="png").write(tmp_path / "first")), str(packed)]) == 1
    printed = capsys.readouterr()
    assert "wrote" not in printed.out
    assert f"{packed}: got " in printed.err
    assert "disk full, 0 MB free" in printed.err
    assert not packed.exists()


def test_a_converted_folder_replays_as_the_folder(tmp_path: Path) -> None:
    first = Tiny(rows=12).write(tmp_path / "first")
    packed = tmp_path / "packed.mcap"
    assert main(["convert", str(first), str(packed)]) == 0
    for source, out in ((first, "a"), (packed, "b")):
        assert main(["replay", str(source), "--out", str(tmp_path / out), "--no-rerun"]) == 0
    assert (tmp_path / "a" / "track.csv").read_bytes() == (tmp_path / "b" / "track.csv").read_bytes()


@pytest.mark.parametrize("packing", [("packed.mcap",), ("bag", "--ros2")], ids=["recording", "ROS bag"])
def test_errors_of_the_axes_are_applied_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], packing: tuple[str, ...]
) -> None:
    """Expected: the readings again with the rig that corrects them; a bag has angles meanwhile, which is noted."""
    axes = "ptu_axes = { pan_zero_deg = 1.5, tilt_scale_ppm = 900.0, lean_deg = 0.2 }"
    first = Tiny(rows=4, video="png", rig_more={"left": axes}).write(tmp_path / "first")
    assert main(["convert", str(first), str(tmp_path / packing[0]), *packing[1:]]) == 0
    assert main(["convert", str(tmp_path / packing[0]), str(tmp_path / "second")]) == 0
    told = capsys.readouterr().out
    assert ("the angles of left are corrected by ptu_axes" in told) is ("--ros2" in packing)
    assert told.count("note") == ("--ros2" in packing)
    assert (tmp_path / "second" / "rig.toml").read_bytes() == (first / "rig.toml").read_bytes()
    given, back = ([e for e in streamed(tmp_path / f) if isinstance(e, PtuSample)] for f in ("first", "second"))
    one, two = ({(e.station, round(e.t_s, 6)): (e.pan_rad, e.tilt_rad) for e in each} for each in (given, back))
    assert one.keys() == two.keys()
    assert all(one[key] == pytest.approx(two[key], abs=1e-12) for key in one)
    leans = [load_session(tmp_path / f).rig["left"].ptu_axes.lean_rad for f in ("first", "second")]
    assert leans[0] == pytest.approx(leans[1], abs=1e-12)
    assert leans[0] != 0.0


def test_pixels_that_others_found_go_both_ways(tmp_path: Path) -> None:
    first = Tiny(rows=5, video="").write(tmp_path / "first")
    (first / "frames.csv").unlink()
    # every other pixel carries its sigma
    rows = [
        f"{1.0 + 0.1 * k},{n},{30 + k}.25,20.125,{'0.5,0.75' if k % 2 else ','}"
        for k in range(8)
        for n in ("left", "right")
    ]
    header = "t_s,station,u_px,v_px,sigma_u_px,sigma_v_px"
    (first / "detections.csv").write_text("\n".join([header, *rows]) + "\n")
    packed, second = tmp_path / "packed.mcap", tmp_path / "second"
    assert main(["convert", str(first), str(packed)]) == 0
    assert main(["convert", str(packed), str(second)]) == 0
    assert streamed(first) == streamed(packed) == streamed(second)


def test_heartbeats_are_not_in_a_folder_and_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: they are read back from the recording; its folder states how many it lacks, and replays."""
    path, folder = tmp_path / "flight.mcap", tmp_path / "folder"
    given = [*events(12, np.random.default_rng(1)), *(Heartbeat(t_s=101.0 + 0.1 * k) for k in range(3))]
    with Recorder(path, small_rig(), header(), PATIENT) as recorder:
        for event in recorder.taken(given):
            recorder.write(looked_at(event))
    assert [e for e in streamed(path) if isinstance(e, Heartbeat)] == given[-3:]
    assert main(["convert", str(path), str(folder)]) == 0
    assert "3 heartbeats are not in the folder, which has no time but that of its records" in capsys.readouterr().out
    assert not [e for e in streamed(folder) if isinstance(e, Heartbeat)]


def test_pixels_that_were_not_recorded_are_black_and_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, folder = tmp_path / "flight.mcap", tmp_path / "folder"
    given = list(events(12, np.random.default_rng(1)))
    with Recorder(path, small_rig(), header(), PATIENT) as recorder:
        for event in recorder.taken(given):
            recorder.write(looked_at(event))
    assert main(["convert", str(path), str(folder)]) == 0
    reported = capsys.readouterr().out
    assert "note: 20 of 24 pictures hold only what detection read; the rest is black" in reported
    assert "2 positions that the filter learnt from are not in the folder" in reported
    assert (folder / "session.toml").read_text().startswith("# 20 of 24 pictures hold only")
    x0, y0, x1, y1 = WINDOW
    for frame in given:
        if isinstance(frame, Frame):
            image = cv2.imread(str(folder / frame.station / f"{frame.epoch:06d}.png"))
            assert image is not None
            np.testing.assert_array_equal(image[y0:y1, x0:x1], frame.image.window(WINDOW)[0])
            if frame.epoch % 10:
                assert not image[:, x1 + 8 :].any()
            else:
                np.testing.assert_array_equal(image, frame.image.whole())


def test_a_full_disk_leaves_no_half_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: of what does not fit nothing is there, as where files may be of 100 bytes at most."""
    recording, back = tmp_path / "first.mcap", tmp_path / "back"
    assert main(["convert", str(Tiny(rows=3).write(tmp_path / "first")), str(recording)]) == 0
    with files_of_at_most(100):
        code = main(["convert", str(recording), str(back)])
    assert code == 1
    assert "back: got File too large; wanted a folder to write to" in capsys.readouterr().err
    sources = {path.name: path.read_bytes() for path in (tmp_path / "first").iterdir() if path.is_file()}
    for path in (path for path in back.rglob("*") if path.is_file()):
        assert path.read_bytes().endswith(sources[path.name])


def test_a_part_in_which_a_recording_has_nothing_is_told_with_its_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: as where a folder has nothing there."""
    folder, recording = Tiny(rows=3).write(tmp_path / "first"), tmp_path / "first.mcap"
    assert main(["convert", str(folder), str(recording)]) == 0
    for source, where in ((recording, "tiny"), (folder, "tiny: frames.csv")):
        capsys.readouterr()
        target = tmp_path / ("back" if source is recording else "other.mcap")
        assert main(["convert", str(source), str(target), "--from", "99"]) == 1
        told = capsys.readouterr().err.splitlines()[-1]
        assert told == f"groundstation: {where}: got times from 1 to 1.2 s; wanted some from 99 s on"


def test_the_commands_report_errors_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = Tiny(rows=3).write(tmp_path / "first")
    (tmp_path / "text.mcap").write_text("hello")
    for arguments, words in (
        (["convert", str(folder), str(tmp_path / "other")], "both folders"),
        (
            ["convert", str(folder), str(tmp_path / "y.mpac")],
            "a name that ends in .mpac; wanted a file that ends in .mcap",
        ),
        (
            ["convert", str(folder), str(folder / "none" / "x.mcap")],
            f"No such file or directory; wanted a file in a folder that is there: {folder / 'none'} is not",
        ),
        (
            ["convert", str(folder), "/dev/null"],
            "a pipe or a device; wanted a file that ends in .mcap, or a new folder",
        ),
        (["convert", "/dev/null", str(tmp_path / "other")], "a pipe or a device; wanted a session folder"),
        (["convert", str(tmp_path / "text.mcap"), str(tmp_path / "other")], "no MCAP"),
        (["convert", str(tmp_path / "none.mcap"), str(tmp_path / "other")], "no such file"),
        (["convert", str(folder), str(tmp_path / "track.kml")], "one of the results of replay and evaluate --out"),
        (["convert", str(tmp_path / "none.mcap"), str(tmp_path / "x.GeoJSON")], "a name that ends in .GeoJSON"),
        (["recover", str(tmp_path / "none.mcap")], "no such file"),
        (["recover", "."], ".: got a folder; wanted a recording, .mcap"),
        (["recover", str(tmp_path / "text.mcap")], "no MCAP"),
        (["recover", str(folder)], "got a folder; wanted a recording, .mcap"),
        (["recover", "/dev/null"], "got a pipe or a device; wanted a recording, .mcap"),
        (["replay", str(tmp_path / "text.mcap"), "--out", str(tmp_path / "out")], "no MCAP"),
    ):
        # what a folder is converted to is read off the name that is typed
        assert main(arguments) == (2 if arguments[-1].endswith((".kml", ".GeoJSON")) else 1)
        shown = capsys.readouterr()
        assert words in shown.err
        assert shown.err.startswith("groundstation: ")
        assert len([text for text in shown.err.splitlines() if text.startswith("groundstation")]) == 1
        assert "Traceback" not in shown.err


def test_recover_prints_its_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "flight.mcap"
    config = type(PATIENT)(patient=True, chunk_bytes=4096)
    with Recorder(path, small_rig(), header(), config) as recorder:
        for event in recorder.taken(events(12, np.random.default_rng(1))):
            recorder.write(looked_at(event))
    assert main(["recover", str(path)]) == 0
    assert "is whole" in capsys.readouterr().out
    path.write_bytes(path.read_bytes()[:-9000])
    assert main(["recover", str(path)]) == 0
    reported = capsys.readouterr().out
    assert "counted again in the new file" in reported
    assert "/groundstation/events" in reported
    assert f"wrote {tmp_path / 'flight-recovered.mcap'}" in reported


def test_a_replay_reports_missing_pictures_of_the_recording(tmp_path: Path) -> None:
    first = Tiny(rows=12).write(tmp_path / "first")
    session = load_session(first)
    path, out = tmp_path / "flight.mcap", tmp_path / "out"
    described = build_header(session, None, Config(), initial=None, learns_from_reference=False)
    # nothing of a picture may wait: each is dropped at once
    config = RecorderConfig(queue_picture_bytes=1)
    with session_source(session) as source, Recorder(path, session.rig, described, config, whole_frames=True) as sink:
        for event in source:
            sink.take(event)
    assert sink.status.pictures_dropped == 24
    assert main(["replay", str(path), "--out", str(out), "--no-rerun"]) == 0
    faults = json.loads((out / "summary.json").read_text())["faults"]
    assert any("lacks the pictures of 24 frames and 0 events" in f and "from epoch 0 on" in f for f in faults)
    assert len((out / "track.csv").read_text().splitlines()) == 13


@pytest.mark.parametrize("command", ["recover", "convert"])
def test_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main([command, "--help"])
    assert left.value.code == 0
    reported = capsys.readouterr().out
    assert "exit code" in reported
    assert "example" in reported
    assert all(len(text) <= 80 for text in reported.splitlines())


@pytest.mark.parametrize(
    ("span", "words"),
    [
        (["--from", "nan"], "got 'nan'; wanted a session time in s"),
        (["--to", "nan"], "got 'nan'; wanted a session time in s"),
        (["--to", "inf"], "got 'inf'; wanted a session time in s"),
        (["--from", "3", "--to", "2"], "wanted an end after the beginning"),
    ],
)
def test_times_that_are_none_are_refused(
    span: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: wrong usage, and nothing written."""
    session = Tiny(rows=3).write(tmp_path / "session")
    try:
        code = main(["convert", str(session), str(tmp_path / "out.mcap"), *span])
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out.mcap").exists()
