"""`groundstation onboard render` and `onboard fly` as a user meets them."""

import csv
import re
import shutil
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.onboard import fly_sinks as onboard_fly_sinks
from groundstation.onboard.edges.camera_file import load_nose_camera
from groundstation.onboard.edges.config import TrackerConfig, config_by_poses
from groundstation.onboard.edges.imu_file import load_imu
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.edges.undistortion import Undistorter
from groundstation.onboard.pose.inertial_filter import NavigationStatus, UpdateOutcome
from groundstation.onboard.scenes.sequences import SEQUENCES
from groundstation.onboard.visual_inertial import nose_navigator
from groundstation.onboard.visual_inertial.corner_finder import NoCorners
from groundstation.onboard.visual_inertial.ground_track import GroundTrackError, read_ground_track
from groundstation.onboard.visual_inertial.nose_report import OTHER_WIDTH, NoseFix, NoseReport
from groundstation.onboard.visual_inertial.outcome_text import USED, WORDS, why_unused
from groundstation.onboard.visual_inertial.track_file import PICTURE_COLUMNS, TRACK_COLUMNS
from groundstation.simulation import jsbsim_model
from groundstation.sources.video_file import VideoFile
from tests.complaints import complaint
from tests.damaged_video import damage

FRAMES = 14


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    assert main(["onboard", "render", "--out", str(folder), "--frames", str(FRAMES), "--seed", "2"]) == 0
    return folder


def run(flight: Path, out: Path, *options: str, camera: Path | None = None, imu: Path | None = None) -> int:
    camera, log = camera or flight / "nose.toml", imu or flight / "imu.csv"
    call = ["onboard", "fly", str(flight / "nose.avi"), "--camera", str(camera), "--imu", str(log), "--out", str(out)]
    return main([*call, *options])


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def test_a_rendered_flight_is_followed(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert {p.name for p in flight.iterdir()} == {"nose.avi", "nose.toml", "imu.csv", "truth.csv"}
    assert run(flight, tmp_path / "out") == 0
    reported = capsys.readouterr().out
    assert f"{FRAMES} pictures: " in reported
    names = {"track.csv", "track.tum", "pictures.csv", "fly.mp4", "fly.rrd"}
    assert {p.name for p in (tmp_path / "out").iterdir()} == names
    track, truth = rows(tmp_path / "out" / "track.csv"), rows(flight / "truth.csv")
    assert tuple(track[0]) == TRACK_COLUMNS
    assert tuple(rows(tmp_path / "out" / "pictures.csv")[0]) == PICTURE_COLUMNS
    known = [(a, b) for a, b in zip(track, truth, strict=True) if a["status"] == "aided"]
    assert len(known) >= 4
    for a, b in known:
        for axis, cov in zip("xyz", ("cov_xx_m2", "cov_yy_m2", "cov_zz_m2"), strict=True):
            assert abs(float(a[f"{axis}_m"]) - float(b[f"{axis}_m"])) < 4.0 * float(a[cov]) ** 0.5
        assert abs(float(a["roll_deg"]) - float(b["roll_deg"])) < 2.0
        assert abs(float(a["yaw_deg"]) - float(b["yaw_deg"])) < 2.0
    assert len((tmp_path / "out" / "track.tum").read_text().split()) == 8 * len(known)


def test_a_ground_track_is_compared(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: the truth in the ground's own frame agrees; 40 m aside does not, which is exit code 1."""
    truth = rows(flight / "truth.csv")
    for aside, code, words in ((0.0, 0, "ground track: agrees"), (40.0, 1, "ground track: does not agree")):
        lines = [f"{r['t_s']} {float(r['x_m']) + 3 + aside} {float(r['y_m']) - 9} {r['z_m']} 0 0 0 1" for r in truth]
        (tmp_path / "ground.tum").write_text("# t x y z\n" + "\n".join(lines) + "\n")
        track = ["--ground-track", str(tmp_path / "ground.tum"), "--threshold-m", "3,-9,0", "--no-rerun"]
        assert run(flight, tmp_path / "out", *track) == code
        assert words in capsys.readouterr().out
        assert len(rows(tmp_path / "out" / "agreement.csv")) >= 4


def test_bad_input_is_one_line(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = tmp_path / "imu.csv"
    short.write_text("t_s,force_x_m_s2\n0,1\n")
    out = tmp_path / "out"
    cases = (
        (lambda: run(flight, out, imu=short), 1, "a column force_y_m_s2"),
        (lambda: run(flight, out, imu=tmp_path / "none.csv"), 1, "no such file"),
        (lambda: run(flight, out, "--ground-track", str(tmp_path / "no.tum")), 1, "no such file"),
        (lambda: run(flight, out, "--runway", "LFRS_03"), 2, "--runways FILE and --runway"),
    )
    for call, code, words in cases:
        assert call() == code
        reported = capsys.readouterr().err
        assert words in reported
        assert reported.count("\n") == 1
    plain = tmp_path / "plain.csv"
    head = "t_s,force_x_m_s2,force_y_m_s2,force_z_m_s2,rate_x_deg_s,rate_y_deg_s,rate_z_deg_s\n"
    plain.write_text(head + "0,0,0,-9.8,0,0,0\n1,0,0,-9.8,0,0,0\n")
    camera = tmp_path / "nose.toml"
    text = (flight / "nose.toml").read_text()
    camera.write_text(text[: text.index("[start]")] + text[text.index("[imu]") :])
    assert run(flight, out, camera=camera, imu=plain) == 1
    assert "a [start] table" in capsys.readouterr().err
    plain.write_text(head + "1,0,0,-9.8,0,0,0\n1,0,0,-9.8,0,0,0\n")
    assert run(flight, out, imu=plain) == 1
    assert "growing times" in capsys.readouterr().err
    with pytest.raises(SystemExit) as ended:
        run(flight, out, "--threshold-m", "1,2")
    assert ended.value.code == 2


@pytest.mark.parametrize("missing", [("width_m",), ("length_m",), ("width_m", "length_m")])
def test_the_runways_size_is_never_assumed_silently(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], missing: tuple[str, ...]
) -> None:
    """Expected: a camera file without it is refused, unless a surveyed runway is named; `edges` takes it as before."""
    lines = (flight / "nose.toml").read_text().splitlines()
    camera = tmp_path / "nose.toml"
    camera.write_text("\n".join(line for line in lines if not line.startswith(missing)) + "\n")
    assert run(flight, tmp_path / "out", camera=camera) == 1
    reported = capsys.readouterr().err
    assert f"runway: got no {' and no '.join(missing)}; wanted the runway's own size in m" in reported
    assert not (tmp_path / "out").exists()
    table = tmp_path / "runways.json"
    table.write_text("{}")
    assert run(flight, tmp_path / "out", "--runways", str(table), "--runway", "LFRS_03", camera=camera) == 1
    assert "runways.json: got airport 'LFRS'; wanted one of runways.json: nothing" in capsys.readouterr().err
    assert load_nose_camera(camera).unsaid == missing
    assert load_nose_camera(camera).guess.width_announced == ("width_m" not in missing)


def test_a_flight_without_a_pose_is_no_success(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: given a runway of another size, exit code 1, and what the pictures had, as in pictures.csv."""
    text = (flight / "nose.toml").read_text()
    camera = tmp_path / "nose.toml"
    camera.write_text(re.sub(r"length_m = .*", "length_m = 1500.0", re.sub(r"width_m = .*", "width_m = 30.0", text)))
    assert run(flight, tmp_path / "out", "--no-rerun", camera=camera) == 1
    shown = capsys.readouterr()
    assert f"trajectory: waiting {FRAMES}" in shown.out
    assert f"no pose was used, so there is no trajectory; of {FRAMES} pictures " in shown.err
    for outcome, count in Counter(row["outcome"] for row in rows(tmp_path / "out" / "pictures.csv")).items():
        assert f"{count} had {WORDS[outcome]} ({outcome})" in shown.err
    assert "Is the runway 30 m wide and 1500 m long?" in shown.err
    # and what failed: edges that were followed, of a runway of another width
    apart = re.search(r"Edges were ([0-9.]+) m apart in the median where 30 m are announced", shown.err)
    assert apart is not None
    assert float(apart[1]) == pytest.approx(SEQUENCES[0].airfield.width_m, abs=2.5)
    assert f" {OTHER_WIDTH}. " in shown.err.splitlines()[-1]


@pytest.mark.parametrize("by_log", [True, False])
def test_edges_are_tracked_with_the_tuning_for_their_poses(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, by_log: bool
) -> None:
    """Expected: what `[pose_noise]` states of a log's poses, and that of the pictures' motion where it has none."""
    made: list[TrackerConfig] = []

    class Seen(EdgeTracker):
        def __init__(self, kappa: FloatArray, image_size_px: tuple[int, int], config: TrackerConfig) -> None:
            made.append(config)
            super().__init__(kappa, image_size_px, config)

    monkeypatch.setattr(nose_navigator, "EdgeTracker", Seen)
    camera, log = tmp_path / "nose.toml", tmp_path / "imu.csv"
    camera.write_text((flight / "nose.toml").read_text() + "\n[pose_noise]\nattitude_deg = 0.4\nposition_m = 2.5\n")
    left_out = () if by_log else ("roll_deg", "pitch_deg", "yaw_deg")
    with log.open("w", newline="") as stream:
        samples = rows(flight / "imu.csv")
        out = csv.DictWriter(stream, [name for name in samples[0] if name not in left_out], extrasaction="ignore")
        out.writeheader()
        out.writerows(samples)
    run(flight, tmp_path / "out", "--no-rerun", camera=camera, imu=log)
    read = load_nose_camera(camera)
    assert made[0] == config_by_poses(read.guess, read.noise if by_log else None)
    assert made[0].position_sigma_m[0] == (2.5 if by_log else 0.3)


def test_every_outcome_has_words() -> None:
    """Expected: all that `NoseReport.outcome` can be that is not a use, in the words and on the page."""
    parts = {"no_pose", "no_edges", "edges_alone", "no_fit", *NoCorners, *UpdateOutcome} - USED
    assert set(WORDS) == parts
    page = (Path(__file__).parents[2] / "docs" / "onboard-fly.md").read_text(encoding="utf-8")
    for name in parts | USED:
        assert f"`{name}`" in page
    assert why_unused({"gated": 3, "used": 1}, 500.0, 20.0) == ""
    assert why_unused({}, 500.0, 20.0).startswith("there was no picture")
    often = why_unused({"edges_alone": 2, "flat": 5}, 500.0, 20.0)
    assert f" 5 had {WORDS['flat']} (flat); 2 had {WORDS['edges_alone']} (edges_alone). Is the runway 20 m" in often
    assert "Is the runway" not in why_unused({"no_pose": 2, "late": 5}, 500.0, 20.0)


def test_a_rendered_camera_file_starts_where_its_log_does(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: so that `onboard edges` can do without the log."""
    camera = load_nose_camera(flight / "nose.toml")
    log = load_imu(flight / "imu.csv", camera)
    first = log.pose(0.0)
    assert first is not None
    assert camera.start is not None
    np.testing.assert_allclose(camera.start.camera_threshold_m, first.camera_threshold_m, atol=1e-3)
    np.testing.assert_allclose(camera.start.threshold_from_camera, first.threshold_from_camera, atol=2e-5)
    call = ["onboard", "edges", str(flight / "nose.avi"), "--camera", str(flight / "nose.toml"), "--no-rerun"]
    assert main([*call, "--out", str(tmp_path / "out")]) == 0
    assert "tracking" in capsys.readouterr().out


def test_what_is_drawn_into_the_pictures_can_be_drawn(flight: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: place and sigma in characters that OpenCV 4 has as well."""
    drawn: list[str] = []
    monkeypatch.setattr(onboard_fly_sinks.cv2, "putText", lambda image, text, *more: drawn.append(text))
    fix = NoseFix(
        t_s=0.0,
        position_m=np.array([1.24, 200.4, 8.06]),
        velocity_m_s=np.zeros(3),
        runway_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        covariance=np.diag(np.array([0.3, 4.0, 0.2, *[1.0] * 6]) ** 2),
        status=NavigationStatus.AIDED,
    )
    report = NoseReport(t_s=0.0, tracker_pose=None, edges=None, corners=None, pose=None, innovation=None, fix=fix)
    camera = load_nose_camera(flight / "nose.toml")
    picture = np.zeros((camera.lens.image_size_px[1], camera.lens.image_size_px[0], 3), np.uint8)
    onboard_fly_sinks.draw_sight(picture, 3, report, None, Undistorter(camera.lens))
    assert drawn[-1] == "no_pose  x 1.2  y 200  z 8.1 m, sigma 0.3  4  0.2"
    assert all(text.isascii() for text in drawn)


def test_what_is_read_is_not_written_over(flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: nothing at all is written, by the file's own name, a link's, or another way to its folder."""
    video, imu, out = tmp_path / "fly.mp4", tmp_path / "track.csv", tmp_path / "out"
    shutil.copy(flight / "nose.avi", video)
    shutil.copy(flight / "imu.csv", imu)
    out.mkdir()
    (out / "track.tum").hardlink_to(flight / "truth.csv")
    camera = ["--camera", str(flight / "nose.toml")]
    cases = (
        (video, flight / "imu.csv", tmp_path, None),
        (flight / "nose.avi", imu, out / "..", None),
        (flight / "nose.avi", flight / "imu.csv", out, flight / "truth.csv"),
    )
    before = {path: path.read_bytes() for path in (video, imu, flight / "truth.csv")}
    for film, log, to, ground in cases:
        call = ["onboard", "fly", str(film), *camera, "--imu", str(log), "--out", str(to)]
        assert main([*call, *([] if ground is None else ["--ground-track", str(ground)])]) == 1
        assert "got a file that is read; wanted another --out" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in before} == before
    assert {path.name for path in tmp_path.iterdir()} == {"fly.mp4", "track.csv", "out"}


def test_a_rendered_flight_takes_no_files_place(
    flight: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    before = (flight / "nose.toml").read_bytes()
    (tmp_path / "nose.toml").write_bytes(before)
    assert main(["onboard", "render", "--out", str(tmp_path), "--frames", "2", "--scene", "night"]) == 1
    assert "nose.toml: got a file that is there already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["nose.toml"]
    assert (tmp_path / "nose.toml").read_bytes() == before
    for seed in ("-1", "x", "1" * 10, "²"):
        with pytest.raises(SystemExit) as ended:
            main(["onboard", "render", "--out", str(tmp_path / "n"), "--frames", "2", "--seed", seed])
        assert ended.value.code == 2
        assert "wanted a whole number from 0" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("factor", "shift_s", "words"),
    [
        ((1 / 9.80665,) * 3, 0.0, "in the median; are they in g?; wanted specific force in m/s²"),
        ((3.2808,) * 3, 0.0, "are they in ft/s²?"),
        ((0.2, 0.2, 0.2), 0.0, "has gravity been taken off them?"),
        ((1.0, -1.0, -1.0), 0.0, "are the axes forward, left, up?"),
        ((1.0, 1.0, 1.0), 1000.0, "got times from 1000 to"),
    ],
)
def test_a_log_that_is_not_this_flights_is_refused(
    flight: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    factor: tuple[float, float, float],
    shift_s: float,
    words: str,
) -> None:
    log = rows(flight / "imu.csv")
    with (tmp_path / "imu.csv").open("w", newline="") as stream:
        out = csv.DictWriter(stream, list(log[0]))
        out.writeheader()
        for row in log:
            forces = {f"force_{a}_m_s2": float(row[f"force_{a}_m_s2"]) * f for a, f in zip("xyz", factor, strict=True)}
            out.writerow({**row, **forces, "t_s": float(row["t_s"]) + shift_s})
    assert run(flight, tmp_path / "out", imu=tmp_path / "imu.csv") == 1
    reported = capsys.readouterr().err
    assert words in reported
    assert reported.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_ground_track_of_another_time_is_refused(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "g.tum").write_text("50 0 200 9 0 0 0 1\n60 0 100 9 0 0 0 1\n")
    assert run(flight, tmp_path / "out", "--ground-track", str(tmp_path / "g.tum")) == 1
    assert "got times from 50 to 60 s; wanted the video's, from 0 to 1.4 s" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("g.tum", "0 1 2 3\n", "t x y z qx qy qz qw"),
        ("g.tum", "0 1 2 nan 0 0 0 1\n", "line 1"),
        ("g.tum", "1 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1\n", "g.tum: time: got 1 after 1 s; wanted growing times"),
        ("g.tum", "1 1 2 3 0 0 0 1\n", "got 1 positions; wanted a track of two or more"),
        ("g.csv", "t_s,x_m\n0,1\n", "a column y_m"),
    ],
)
def test_a_bad_ground_track_is_reported(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text)
    assert words in complaint(InputError, lambda: read_ground_track(tmp_path / name, np.zeros(3), 1.0))
    with pytest.raises(GroundTrackError):
        read_ground_track(tmp_path / "none.csv", np.zeros(3), 1.0)


def test_a_replays_track_brings_its_covariance(tmp_path: Path) -> None:
    columns = "t_s,x_m,y_m,z_m,cov_xx_m2,cov_xy_m2,cov_xz_m2,cov_yy_m2,cov_yz_m2,cov_zz_m2"
    body = "0,,,,,,,,,\n1,1,2,3,4,1,0,5,0,6\n2,1,2,3,4,1,0,5,0,6\n"
    (tmp_path / "track.csv").write_text(columns + "\n" + body)
    found = read_ground_track(tmp_path / "track.csv", np.array([1.0, 0.0, 0.0]), 9.0)
    np.testing.assert_array_equal(found.t_s, [1.0, 2.0])
    np.testing.assert_array_equal(found.position_m[0], [0.0, 2.0, 3.0])
    np.testing.assert_array_equal(found.covariance_m2[0], [[4, 1, 0], [1, 5, 0], [0, 0, 6]])


def test_without_jsbsim_the_message_states_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def none(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(jsbsim_model, "import_module", none)
    assert main(["onboard", "render", "--out", str(tmp_path), "--motion", "jsbsim", "--frames", "2"]) == 1
    assert "pip install 'groundstation[jsbsim]'" in capsys.readouterr().err
    assert main(["simulate", "--out", str(tmp_path / "s"), "--aircraft", "jsbsim", "--duration", "0.3"]) == 1
    assert "pip install 'groundstation[jsbsim]'" in capsys.readouterr().err


def test_the_same_seed_gives_the_same_flight(tmp_path: Path) -> None:
    for name in ("a", "b"):
        call = ["onboard", "render", "--out", str(tmp_path / name), "--frames", "2", "--scene", "night"]
        assert main([*call, "--motion", "jsbsim"]) == 0
    for name in ("imu.csv", "truth.csv", "nose.avi"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_damaged_pictures_are_left_out_and_reported(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: the pictures after them are used as before, and a line states how many are missing."""
    shutil.copytree(flight, tmp_path / "flight")
    nose = tmp_path / "flight" / "nose.avi"
    source = VideoFile(flight / "nose.avi")
    writer = cv2.VideoWriter(str(nose), cv2.VideoWriter.fourcc(*"MJPG"), source.rate_hz, source.size_px)
    for frame in source.frames():
        writer.write(frame.image)
    writer.release()
    damage(nose, range(3, 5))
    assert run(tmp_path / "flight", tmp_path / "out", "--no-rerun") == 0
    numbers = [int(row["frame"]) for row in rows(tmp_path / "out" / "pictures.csv")]
    assert numbers == [0, 1, 2, *range(5, FRAMES)]
    assert "groundstation: 2 damaged frames in " in capsys.readouterr().err
