"""`groundstation onboard edges` as a user meets it, on a few rendered frames."""

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.onboard.edges.camera_file import CameraFileError, load_nose_camera
from groundstation.onboard.edges.edges_file import EDGE_COLUMNS
from groundstation.onboard.edges.imu_file import ImuFileError, load_imu
from groundstation.onboard.edges.undistortion import Undistorter
from groundstation.onboard.scenes.sequences import SEQUENCES, Renderer
from groundstation.onboard.video import EdgesResult, format_edges_summary
from tests.complaints import complaint
from tests.damaged_video import damage

LENS = """image_size_px = [640, 480]
focal_px = [620.0, 620.0]
principal_point_px = [319.5, 239.5]
"""
START = "[start]\nheight_m = 21.9\n"
FRAMES = 5


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a video, its camera file and its IMU table."""
    folder = tmp_path_factory.mktemp("flight")
    sequence = SEQUENCES[0]
    renderer = Renderer(replace(sequence, approach=replace(sequence.approach, frames=FRAMES)))
    writer = cv2.VideoWriter(str(folder / "nose.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (640, 480))
    rows = ["t_s,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg"]
    for frame in renderer.frames():
        writer.write(frame.image)
        reported = renderer.reported
        numbers = [*reported.position_threshold_m[frame.index], *np.degrees(reported.attitude_rad[frame.index])]
        rows.append(",".join(f"{v:.6f}" for v in (frame.t_s, *numbers)))
    writer.release()
    (folder / "imu.csv").write_text("\n".join(rows) + "\n")
    x, y, z = renderer.reported.position_threshold_m[0]
    roll, pitch, yaw = np.degrees(renderer.reported.attitude_rad[0])
    start = f"[start]\nheight_m = {z}\ndistance_m = {y}\nlateral_m = {x}\n"
    start += f"roll_deg = {roll}\npitch_deg = {pitch}\nyaw_deg = {yaw}\n"
    (folder / "nose.toml").write_text(LENS + start)
    return folder


def run(flight: Path, out: Path, *options: str) -> int:
    return main(
        [
            "onboard",
            "edges",
            str(flight / "nose.avi"),
            "--camera",
            str(flight / "nose.toml"),
            "--out",
            str(out),
            *options,
        ]
    )


def test_a_video_with_an_imu_gives_a_table_a_video_and_a_recording(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(flight, tmp_path / "out", "--imu", str(flight / "imu.csv")) == 0
    assert f"{FRAMES} frames: acquiring 3, tracking {FRAMES - 3}" in capsys.readouterr().out
    with (tmp_path / "out" / "edges.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == EDGE_COLUMNS
    assert [row["status"] for row in rows] == ["acquiring"] * 3 + ["tracking"] * (FRAMES - 3)
    assert all(float(row["far_left_u_px"]) < float(row["far_right_u_px"]) for row in rows)
    assert abs(float(rows[-1]["d_m"]) - float(rows[-1]["c_m"]) - 18.0) < 4.0
    assert 0.0 < float(rows[-1]["sigma_near_left_px"]) < 5.0
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"edges.csv", "edges.mp4", "edges.rrd"}


def test_without_an_imu_the_motion_is_estimated_from_the_pictures(flight: Path, tmp_path: Path) -> None:
    assert run(flight, tmp_path / "out", "--no-rerun") == 0
    table = (tmp_path / "out" / "edges.csv").read_text()
    assert (table.count("acquiring"), table.count("tracking")) == (3, FRAMES - 3)
    assert not (tmp_path / "out" / "edges.rrd").exists()


def test_frames_outside_the_imu_table_have_no_pose(flight: Path, tmp_path: Path) -> None:
    short = tmp_path / "short.csv"
    short.write_text("\n".join((flight / "imu.csv").read_text().splitlines()[:4]) + "\n")
    assert run(flight, tmp_path / "out", "--no-rerun", "--imu", str(short)) == 0
    assert (tmp_path / "out" / "edges.csv").read_text().count("no_pose") == FRAMES - 3


def test_a_log_at_one_hertz_is_carried_on_and_its_row_on_the_ground_left_out(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: the first picture's row and the pictures' motion after it; a touchdown refuses a row, not the file."""
    lines = (flight / "imu.csv").read_text().splitlines()
    x, y, z, *attitude = lines[-1].split(",")[1:]
    after = [f"1.0,{x},{y},{z},{','.join(attitude)}", f"2.0,{x},{y},-0.2,{','.join(attitude)}"]
    sparse = tmp_path / "sparse.csv"
    sparse.write_text("\n".join([*lines[:2], *after]) + "\n")
    assert run(flight, tmp_path / "out", "--no-rerun", "--imu", str(sparse)) == 0
    told = capsys.readouterr().out
    assert f"{FRAMES} frames: acquiring 3, tracking {FRAMES - 3}" in told
    assert f"poses: 1 of the table, {FRAMES - 1} in its gaps by the motion between pictures" in told
    assert "sparse.csv: 1 row is at or below the threshold's height and not used, the first in line 4" in told


def test_an_interrupted_run_says_where_its_table_ends(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: exit code 130, whole rows until then, their number told, no recording half written."""
    steps = iter(range(FRAMES))

    def drawn(*_: object) -> np.ndarray:
        if next(steps) == 4:
            raise KeyboardInterrupt
        return np.zeros((480, 640, 3), np.uint8)

    monkeypatch.setattr("groundstation.onboard.video.draw_edges", drawn)
    assert run(flight, tmp_path / "out", "--imu", str(flight / "imu.csv")) == 130
    out = tmp_path / "out"
    said = capsys.readouterr().err.splitlines()[-1]
    assert said == f"groundstation: interrupted; {out} holds what was done until then; edges.csv ends after 5 frames"
    text = (out / "edges.csv").read_text()
    assert text.endswith("\n")
    assert [len(line.split(",")) for line in text.splitlines()] == [len(EDGE_COLUMNS)] * 6
    assert {path.name for path in out.iterdir()} == {"edges.csv", "edges.mp4"}
    assert cv2.VideoCapture(str(out / "edges.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 4


def test_bad_input_is_one_line_and_exit_code_1(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cases = {
        LENS: "wanted a [start] table, or --imu",
        LENS.replace("640", "320") + START: "got pictures of 640×480 px",
        LENS + "zoom = 3\n": "an unknown key",
        LENS.replace("[620.0, 620.0]", "[0.0, 620.0]") + START: "focal_px",
        LENS.replace("[620.0, 620.0]", "3401.6") + START: "got 3401.6; wanted 2 finite numbers, [fx, fy]",
        LENS.replace("[640, 480]", "640") + START: "wanted 2 finite numbers, [width, height]",
        LENS.replace("[319.5, 239.5]", "[319.5]") + START: "wanted 2 finite numbers, [cx, cy]",
        LENS.replace("[620.0, 620.0]", "[620.0, 1e-9]") + START: "wanted two numbers of px from 64 to 640000",
        "image_size_px = [640": "not TOML",
    }
    for text, words in cases.items():
        camera = tmp_path / "camera.toml"
        camera.write_text(text)
        code = main(
            ["onboard", "edges", str(flight / "nose.avi"), "--camera", str(camera), "--out", str(tmp_path / "out")]
        )
        reported = capsys.readouterr().err
        assert code == 1
        assert words in reported
        assert reported.count("\n") == 1
    assert main(["onboard", "edges", "no.mp4", "--camera", str(flight / "nose.toml"), "--out", str(tmp_path)]) == 1


def test_the_video_is_not_written_over(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    video = tmp_path / "edges.mp4"
    shutil.copy(flight / "nose.avi", video)
    before = video.read_bytes()
    call = ["onboard", "edges", str(video), "--camera", str(flight / "nose.toml"), "--out", str(tmp_path)]
    assert main(call) == 1
    assert "edges.mp4: got a file that is read; wanted another --out" in capsys.readouterr().err
    assert video.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["edges.mp4"]


def test_an_imu_table_of_another_time_is_refused(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    late = tmp_path / "late.csv"
    head, *lines = (flight / "imu.csv").read_text().splitlines()
    late.write_text("\n".join([head, *(f"7{line}" for line in lines)]) + "\n")
    assert run(flight, tmp_path / "out", "--imu", str(late)) == 1
    assert "got times from 70 to 70.4 s; wanted the video's, from 0 to 0.5 s" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_help_describes_the_use(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["onboard", "edges", "--help"])
    reported = capsys.readouterr().out
    for words in ("VIDEO", "--camera FILE", "--imu FILE", "--out DIR", "example", "exit code"):
        assert words in reported


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "an empty file"),
        ("t_s,roll_deg\n0,1\n", "no column"),
        (
            "t_s,roll_deg,pitch_deg,yaw_deg,x_m,y_m,z_m\n0,0,0,0,0,100,9\n\n0,0,0,0,0,99,9\n",
            "imu.csv: line 4: t_s: got 0 after 0; wanted growing times",
        ),
        ("t_s,roll_deg,pitch_deg,yaw_deg,x_m,y_m,z_m\n0,0,0,0,0,100,9\n", "got one row; wanted two or more"),
        ("t_s,roll_deg,pitch_deg,yaw_deg,x_m,y_m,z_m\n", "got no row; wanted two or more"),
        ("t_s,roll_deg,pitch_deg,yaw_deg,x_m,y_m,z_m\n0,0,0,0,0,100,9\n1,0,nan,0,0,99,9\n", "line 3: pitch_deg"),
        ("t_s,roll_deg,pitch_deg,yaw_deg,x_m,y_m,z_m\n0,0,0,0,0,100,9\n1,0,0,0,0,99,-1\n", "below"),
        ("t_s,roll_deg,pitch_deg,yaw_deg,lat_deg,lon_deg,alt_m\n0,0,0,0,1,1,9\n1,0,0,0,1,1,9\n", "[runway]"),
    ],
)
def test_a_bad_imu_table_is_reported(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "nose.toml").write_text(LENS)
    (tmp_path / "imu.csv").write_text(text)
    camera = load_nose_camera(tmp_path / "nose.toml")
    assert words in complaint(ImuFileError, lambda: load_imu(tmp_path / "imu.csv", camera))


def test_a_file_that_is_not_an_imu_table_is_reported_in_words(tmp_path: Path) -> None:
    (tmp_path / "nose.toml").write_text(LENS)
    (tmp_path / "nose.avi").write_bytes(b"RIFF\xa5\x80\n")
    camera = load_nose_camera(tmp_path / "nose.toml")
    for name, words in (
        ("none.csv", "none.csv: got no such file; wanted a CSV table"),
        ("", "got a folder; wanted a CSV table"),
        ("nose.avi", "nose.avi: got bytes that are no text in UTF-8; wanted a CSV table"),
    ):
        path = tmp_path / name
        assert words in complaint(ImuFileError, lambda path=path: load_imu(path, camera))


def test_places_on_earth_become_poses_over_the_threshold(tmp_path: Path) -> None:
    runway = "[runway]\nlat_deg = 30.0\nlon_deg = -97.0\nalt_m = 200.0\nheading_deg = 90.0\n"
    (tmp_path / "nose.toml").write_text(LENS + runway)
    west = -97.0 - 300.0 / (111_320.0 * np.cos(np.radians(30.0)))
    rows = [f"{t},0,0,9{2 * t},30.0,{west},220" for t in (0, 1)]
    (tmp_path / "imu.csv").write_text(
        "t_s,roll_deg,pitch_deg,yaw_deg,lat_deg,lon_deg,alt_m\n" + "\n".join(rows).replace("1,", "0.4,", 0) + "\n"
    )
    log = load_imu(tmp_path / "imu.csv", load_nose_camera(tmp_path / "nose.toml"))
    pose = log.pose(0.0)
    assert pose is not None
    np.testing.assert_allclose(pose.camera_threshold_m, [0.0, 300.0, 20.0], atol=0.6)
    np.testing.assert_allclose(pose.threshold_from_camera[:, 2], [0.0, -1.0, 0.0], atol=1e-9)
    assert log.pose(0.5) is None  # a gap of a second
    at_a_row = log.pose(1.0)
    assert at_a_row is not None
    np.testing.assert_allclose(at_a_row.camera_threshold_m, pose.camera_threshold_m, atol=1e-9)
    assert log.pose(7.0) is None
    (tmp_path / "nose.toml").write_text(LENS + "[runway]\nlat_deg = 30.0\n")
    assert "lon_deg" in complaint(CameraFileError, lambda: load_nose_camera(tmp_path / "nose.toml"))


def test_a_bent_lens_is_straightened_and_its_pixels_go_back(tmp_path: Path) -> None:
    (tmp_path / "nose.toml").write_text(LENS + "distortion = [-0.2, 0.05, 0.001, -0.001, 0.0]\n")
    lens = load_nose_camera(tmp_path / "nose.toml").lens
    flat = Undistorter(lens)
    picture = np.zeros((480, 640, 3), np.uint8)
    picture[100:104, 90:94] = 255
    straight = flat.flat(picture)
    v, u = (float(axis.mean()) for axis in np.nonzero(straight[:, :, 0] > 100))
    assert np.hypot(u - 91.5, v - 101.5) > 5.0
    np.testing.assert_allclose(flat.original(np.array([[u, v]]))[0], [91.5, 101.5], atol=0.6)


def test_damaged_frames_are_left_out_and_reported(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(flight, tmp_path / "flight")
    damage(tmp_path / "flight" / "nose.avi", range(2, 4))
    assert run(tmp_path / "flight", tmp_path / "out", "--imu", str(flight / "imu.csv"), "--no-rerun") == 0
    with (tmp_path / "out" / "edges.csv").open() as file:
        assert [int(row["frame"]) for row in csv.DictReader(file)] == [0, 1, *range(4, FRAMES)]
    reported = capsys.readouterr()
    assert f"{FRAMES - 2} frames: " in reported.out
    assert "groundstation: 2 damaged frames in " in reported.err
    assert "the first number 2" in reported.err


@pytest.mark.parametrize(
    ("statuses", "misses", "words"),
    [
        ({"no_pose": 40}, {}, "no picture has a pose"),
        ({"searching": 40}, {"no_band": 40}, "the runway is in no picture"),
        ({"searching": 40}, {"no_band": 10, "no_pair": 30}, "no picture shows the announced runway"),
        ({"searching": 39, "tracking": 1}, {"no_pair": 39}, ""),
        ({}, {}, ""),
    ],
)
def test_a_video_of_which_nothing_was_measured_says_what_to_look_at(
    statuses: dict[str, int], misses: dict[str, int], words: str
) -> None:
    text = format_edges_summary(EdgesResult(statuses=statuses, misses=misses, files=(), fault=None, damage=None))
    assert words in text
    assert ("right?" in text or "clock?" in text) is bool(words)
