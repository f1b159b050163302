"""Sessions as ROS 2 bags and back: read independently, with foreign topics, and damaged."""

import itertools
import sqlite3
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from groundstation.cli.main import main
from groundstation.conversion.video_frame_pairing import frames_rows
from groundstation.messages import DgpsFix, Event, Frame, PtuSample
from groundstation.session import load_dgps, load_session
from tests.conversion.test_convert import CLOCKS, streamed
from tests.session.folder import SESSION, SIZE, Tiny, picture, rig_text

STORE = get_typestore(Stores.ROS2_HUMBLE)
DGPS = "t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m\n1.0,0,300,20,0.02,0.03,0.05\n1.1,0,299,20,0.02,0.03,0.05\n"
TRACK = (
    "t_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,cov_xx_m2,cov_xy_m2,cov_xz_m2,cov_yy_m2,cov_yz_m2,cov_zz_m2,status\n"
    "1.0,,,,,,,,,,,,,searching\n1.1,0.5,300,20,0,-25,-1,0.01,0.001,0,1.0,0,0.02,tracking\n"
)


def nearly_same(one: Event, other: Event) -> bool:
    """The same record, its stamp to the nanosecond and its angles as a table of degrees has them."""
    if (
        isinstance(one, Frame)
        and isinstance(other, Frame)
        and not np.array_equal(one.image.whole(), other.image.whole())
    ):
        return False
    if isinstance(one, PtuSample) and isinstance(other, PtuSample):
        apart = max(abs(one.pan_rad - other.pan_rad), abs(one.tilt_rad - other.tilt_rad))
        other = replace(other, pan_rad=one.pan_rad, tilt_rad=one.tilt_rad)
    else:
        apart = 0.0
    heads = [(type(e), getattr(e, "station", ""), getattr(e, "epoch", 0)) for e in (one, other)]
    return heads[0] == heads[1] and abs(one.t_s - other.t_s) < 2e-9 and apart < 1e-12


def in_order(events: list[Event]) -> list[Event]:
    """Records of one instant in a fixed order."""
    return sorted(events, key=lambda e: (round(e.t_s, 8), type(e).__name__, getattr(e, "station", "")))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A session with clocks, a missing frame and a reference, and its bag with a track."""
    folder = tmp_path_factory.mktemp("bag")
    stamps = {"left": [1.0, None, *(1.2 + 0.1 * k for k in range(6))]}
    session = Tiny(rows=8, video="png", rig_more=CLOCKS, stamps=stamps).write(folder / "session")
    (session / "dgps.csv").write_text(DGPS)
    (folder / "run").mkdir()
    (folder / "run" / "track.csv").write_text(TRACK)
    assert main(["convert", str(session), str(folder / "ros"), "--ros2", "--run", str(folder / "run")]) == 0
    return session, folder / "ros"


def test_there_and_back(written: tuple[Path, Path], tmp_path: Path) -> None:
    session, bag = written
    assert main(["convert", str(bag), str(tmp_path / "back")]) == 0
    given, back = in_order(streamed(session)), in_order(streamed(tmp_path / "back"))
    assert len(given) > 30
    assert all(nearly_same(one, two) for one, two in zip(given, back, strict=True))
    for name in ("session.toml", "rig.toml"):
        assert (tmp_path / "back" / name).read_bytes() == (session / name).read_bytes()
    fixes: list[tuple[DgpsFix, ...]] = [load_dgps(load_session(f)) for f in (session, tmp_path / "back")]
    for one, two in zip(*fixes, strict=True):
        assert one.t_s == pytest.approx(two.t_s, abs=2e-9)
        np.testing.assert_allclose(one.position_runway_m, two.position_runway_m)
        np.testing.assert_allclose(one.sigma_m, two.sigma_m)


def test_a_bag_as_a_program_that_knows_ros_reads_it(written: tuple[Path, Path]) -> None:
    """Topics, types, stamps and values by rosbags' reader of any bag, and the container by the mcap library."""
    session, bag = written
    rig = load_session(session).rig
    found: dict[str, list[Any]] = {}
    with AnyReader([bag]) as reader:
        kinds = {topic: info.msgtype for topic, info in reader.topics.items()}
        for connection, stamp_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append(message)
            if hasattr(message, "header"):
                assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp_ns
    assert kinds == {
        "/left/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
        "/right/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
        "/left/camera_info": "sensor_msgs/msg/CameraInfo",
        "/right/camera_info": "sensor_msgs/msg/CameraInfo",
        "/left/joint_states": "sensor_msgs/msg/JointState",
        "/right/joint_states": "sensor_msgs/msg/JointState",
        "/reference": "geometry_msgs/msg/PoseWithCovarianceStamped",
        "/track": "nav_msgs/msg/Odometry",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/tf_static": "tf2_msgs/msg/TFMessage",
    }
    frames = [e for e in streamed(session) if isinstance(e, Frame) and e.station == "right"]
    images = found["/right/image_raw/compressed"]
    for frame, image in zip(frames, images, strict=True):
        assert (image.header.stamp.sec + image.header.stamp.nanosec * 1e-9) == pytest.approx(frame.t_s, abs=2e-9)
        np.testing.assert_array_equal(cv2.imdecode(image.data, cv2.IMREAD_COLOR), frame.image.whole())
    info, lens = found["/right/camera_info"][0], rig["right"].lens
    assert (info.width, info.height, info.distortion_model) == (*SIZE, "plumb_bob")
    np.testing.assert_array_equal(info.k[[0, 4, 2, 5]], [*lens.focal_px, *lens.principal_point_px])
    (estimate,) = found["/track"]
    assert (estimate.header.frame_id, estimate.pose.pose.position.y, estimate.twist.twist.linear.y) == (
        "runway",
        300,
        -25,
    )
    covariance = estimate.pose.covariance.reshape(6, 6)
    np.testing.assert_array_equal(covariance[:3, :3], [[0.01, 0.001, 0], [0.001, 1.0, 0], [0, 0, 0.02]])
    with (bag / f"{bag.name}.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == sum(map(len, found.values()))


def test_transforms_lead_to_the_cameras_pose(written: tuple[Path, Path]) -> None:
    session, bag = written
    station = load_session(session).rig["left"]
    edges: dict[tuple[str, str], Any] = {}
    joints = None
    with AnyReader([bag]) as reader:
        for connection, _, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            for each in getattr(message, "transforms", []):
                edges.setdefault((each.header.frame_id, each.child_frame_id), each.transform)
            if connection.topic == "/left/joint_states" and joints is None:
                joints = message
    assert joints is not None
    assert joints.name == ["left_pan", "left_tilt"]
    chain = ("runway", "left_base", "left_head", "left_optical")
    pose = np.eye(4)
    for edge in itertools.pairwise(chain):
        q, t = edges[edge].rotation, edges[edge].translation
        step = np.eye(4)
        step[:3, :3] = rotation(q.w, q.x, q.y, q.z)
        step[:3, 3] = (t.x, t.y, t.z)
        pose = pose @ step
    expected = station.geometry().camera_pose(float(joints.position[0]), float(joints.position[1]))
    np.testing.assert_allclose(pose[:3, 3], expected.position_runway_m, atol=1e-12)
    np.testing.assert_allclose(pose[:3, :3], expected.runway_from_camera, atol=1e-12)


def rotation(w: float, x: float, y: float, z: float) -> np.ndarray:
    """The rotation of a unit quaternion, by its vector form."""
    v = np.array([x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) * (w * w - v @ v) + 2 * np.outer(v, v) + 2 * w * cross


# ------------------------------------------------------------------------------------------ foreign bags
def message(kind: str, **fields: Any) -> Any:
    return STORE.types[kind](**fields)


def header(t_s: float) -> Any:
    stamp = message("builtin_interfaces/msg/Time", sec=1_700_000_000 + int(t_s), nanosec=round(t_s % 1 * 1e9))
    return message("std_msgs/msg/Header", stamp=stamp, frame_id="x")


def foreign(
    folder: Path,
    *,
    encoding: str = "mono8",
    topics: tuple[str, ...] = ("/cam0/image", "/cam1/image"),
    size: tuple[int, int] = SIZE,
    joints: tuple[str, ...] = ("left_pan", "left_tilt", "right_pan", "right_tilt"),
) -> Path:
    """A bag of another program: plain images, both heads' joints on one topic, sqlite3 storage, no calibration."""
    w, h = size
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        images = [writer.add_connection(t, "sensor_msgs/msg/Image", typestore=STORE) for t in topics]
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=STORE)
        for k in range(8):
            t_s = 10.0 + 0.1 * k
            for n, image in enumerate(images):
                pixels = cv2.resize(picture(2 * k + n)[:, :, 0], (w, h), interpolation=cv2.INTER_NEAREST)
                if encoding == "rgb8":
                    pixels = np.dstack([pixels, 0 * pixels, 0 * pixels])
                taken = message(
                    "sensor_msgs/msg/Image",
                    header=header(t_s + 0.001 * n),
                    height=h,
                    width=w,
                    encoding=encoding,
                    is_bigendian=0,
                    step=pixels[0].size,
                    data=pixels.ravel(),
                )
                writer.write(image, round((1.7e9 + t_s) * 1e9), STORE.serialize_cdr(taken, "sensor_msgs/msg/Image"))
            angles = np.array([0.01 * k, 0.02, -0.01 * k, 0.03])
            read = message(
                "sensor_msgs/msg/JointState",
                header=header(t_s + 0.02),
                name=list(joints),
                position=angles,
                velocity=np.zeros(0),
                effort=np.zeros(0),
            )
            writer.write(states, round((1.7e9 + t_s) * 1e9), STORE.serialize_cdr(read, "sensor_msgs/msg/JointState"))
    return folder


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text(("left", "right"), (), {"left": "ptu_clock = { offset_s = 0.25 }"}))
    return path


CAMERAS = ("--topic", "left.image=/cam0/image", "--topic", "right.image=/cam1/image")


@pytest.mark.parametrize("encoding", ["mono8", "rgb8"])
def test_a_foreign_bag_becomes_a_session(tmp_path: Path, rig_file: Path, encoding: str) -> None:
    """Stamps are the devices': what the rig says of a head's clock applies to them."""
    bag = foreign(tmp_path / "bag", encoding=encoding)
    assert main(["convert", str(bag), str(tmp_path / "session"), "--rig", str(rig_file), *CAMERAS]) == 0
    events = streamed(tmp_path / "session")
    frames = [e for e in events if isinstance(e, Frame)]
    assert [f.epoch for f in frames] == [k // 2 for k in range(16)]
    for frame in frames:
        shown = frame.image.whole()
        expected = picture(2 * frame.epoch + (frame.station == "right"))[:, :, 0]
        np.testing.assert_array_equal(shown[:, :, 2], expected)
        np.testing.assert_array_equal(shown[:, :, 0], expected if encoding == "mono8" else 0 * expected)
    read = {s: [e for e in events if isinstance(e, PtuSample) and e.station == s] for s in ("left", "right")}
    assert [e.pan_rad for e in read["right"]] == pytest.approx([-0.01 * k for k in range(8)])
    later = read["left"][0].t_s - read["right"][0].t_s
    assert later == pytest.approx(0.25, abs=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "got several: /cam0/image, /cam1/image; wanted --topic left.image=TOPIC of sensor_msgs/msg/Image"),
        (("--topic", "left.image=/none"), "topic of left.image: got '/none'"),
        (("--topic", "tower.image=/cam0/image"), "got 'tower.image'; wanted one of left.image, right.image"),
        (("--topic", "left.joints=/cam0/image", *CAMERAS), "topic of left.joints: got '/cam0/image'"),
        (("--from", "3"), "none of that with a ROS 2 bag in"),
    ],
)
def test_topics_that_are_not_clear(
    tmp_path: Path, rig_file: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], words: str
) -> None:
    bag = foreign(tmp_path / "bag")
    assert main(["convert", str(bag), str(tmp_path / "session"), "--rig", str(rig_file), *options]) in (1, 2)
    assert words in capsys.readouterr().err
    assert not (tmp_path / "session").exists()


def test_a_topic_without_a_name_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["convert", "bag", "session", "--topic", "left.image"])
    assert ended.value.code == 2
    assert "got 'left.image'; wanted NAME=TOPIC" in capsys.readouterr().err


def test_a_bag_without_a_calibration_asks_for_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = foreign(tmp_path / "bag")
    assert main(["convert", str(bag), str(tmp_path / "session"), *CAMERAS]) == 1
    assert "got a bag without a calibration of the stations; wanted --rig FILE" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"size": (32, 16)}, "as in the rig"),
        ({"encoding": "16UC1"}, "got encoding '16UC1'; wanted bgr8, rgb8, mono8"),
        ({"encoding": "bgr8"}, "bytes for"),
    ],
)
def test_images_that_cannot_be_used(
    tmp_path: Path, rig_file: Path, capsys: pytest.CaptureFixture[str], change: dict[str, Any], words: str
) -> None:
    bag = foreign(tmp_path / "bag", **change)
    assert main(["convert", str(bag), str(tmp_path / "session"), "--rig", str(rig_file), *CAMERAS]) == 1
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "metadata.yaml has no rosbag2_bagfile_information"),
        ("a: [1", "metadata.yaml is no YAML"),
        ("- 1\n", "metadata.yaml has no rosbag2_bagfile_information"),
        ("rosbag2_bagfile_information: 3\n", "metadata.yaml has no rosbag2_bagfile_information"),
    ],
)
def test_metadata_of_no_bag(text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text(text, encoding="utf-8")
    assert main(["convert", str(tmp_path / "bag"), str(tmp_path / "session")]) == 1
    assert f"bag: got no ROS 2 bag ({words}); wanted a folder with metadata.yaml" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["metadata.yaml", "bag.db3"])
def test_damaged_files_are_refused_in_one_line(
    tmp_path: Path, rig_file: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """Cut and overwritten at twelve places: one line, or a session; never anything else."""
    bag = foreign(tmp_path / "bag")
    whole = (bag / name).read_bytes()
    generator = np.random.default_rng(7)
    for k in range(12):
        data = bytearray(whole)
        at = int(generator.integers(0, len(data)))
        if k % 3 == 0:
            data = data[:at]
        else:
            data[at : at + 40] = generator.bytes(len(data[at : at + 40]))
        (bag / name).write_bytes(bytes(data))
        code = main(["convert", str(bag), str(tmp_path / f"session{k}"), "--rig", str(rig_file), *CAMERAS])
        said = capsys.readouterr().err.strip().splitlines()
        assert code in (0, 1)
        assert code == 0 or said[-1].startswith("groundstation: ")


@pytest.mark.parametrize("mode", ["FILE", "message"])
def test_a_bag_that_is_packed_as_a_whole_is_not_unpacked(
    tmp_path: Path, rig_file: Path, capsys: pytest.CaptureFixture[str], mode: str
) -> None:
    bag = foreign(tmp_path / "bag")
    path = bag / "metadata.yaml"
    text = path.read_text().replace("compression_mode: ''", f"compression_mode: {mode}")
    assert mode in text
    path.write_text(text)
    assert main(["convert", str(bag), str(tmp_path / "session"), "--rig", str(rig_file), *CAMERAS]) == 1
    assert f"got compression by {mode.lower()}" in capsys.readouterr().err


def test_without_the_library_the_extra_is_named(
    written: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [n for n in sys.modules if n == "rosbags" or n.startswith("rosbags.")]:
        monkeypatch.setitem(sys.modules, name, None)
    for source, more in ((written[0], ["--ros2"]), (written[1], [])):
        assert main(["convert", str(source), str(tmp_path / "out"), *more]) == 1
        assert "pip install 'groundstation[ros]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("topic", ["/cam0/image", "/joint_states"])
def test_a_damaged_message_ends_it_and_what_came_before_is_written(
    tmp_path: Path, rig_file: Path, capsys: pytest.CaptureFixture[str], topic: str
) -> None:
    bag = foreign(tmp_path / "bag")
    with sqlite3.connect(bag / "bag.db3") as base:
        (number,) = base.execute("SELECT id FROM topics WHERE name = ?", (topic,)).fetchone()
        rows = base.execute("SELECT id FROM messages WHERE topic_id = ? ORDER BY timestamp", (number,)).fetchall()
        base.execute("UPDATE messages SET data = substr(data, 1, 30) WHERE id = ?", rows[4])
    session = tmp_path / "session"
    assert main(["convert", str(bag), str(session), "--rig", str(rig_file), *CAMERAS]) == 1
    assert "a damaged one" in capsys.readouterr().err
    frames = [e for e in streamed(session) if isinstance(e, Frame)]
    assert 7 <= len(frames) <= 10


def test_one_topic_is_not_two_cameras(tmp_path: Path, rig_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = foreign(tmp_path / "bag", topics=("/cam0/image",))
    assert main(["convert", str(bag), str(tmp_path / "session"), "--rig", str(rig_file)]) == 1
    assert "got '/cam0/image', which is that of right, too" in capsys.readouterr().err


def test_joints_that_are_not_told_are_refused_with_their_names(
    tmp_path: Path, rig_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = foreign(tmp_path / "bag", joints=("a", "b", "c", "d"))
    assert main(["convert", str(bag), str(tmp_path / "session"), "--rig", str(rig_file), *CAMERAS]) == 1
    assert "got joints a, b, c, d; wanted pan and tilt of left" in capsys.readouterr().err


def test_a_run_without_a_track_is_refused_before_anything_is_written(
    written: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["convert", str(written[0]), str(tmp_path / "bag"), "--ros2", "--run", str(tmp_path)]) == 1
    assert "track.csv" in capsys.readouterr().err
    assert not (tmp_path / "bag").exists()
    assert main(["convert", str(written[0]), str(tmp_path / "bag.mcap"), "--ros2"]) == 2
    assert "OUT: got " in (reported := capsys.readouterr().err)
    assert "bag.mcap; wanted a new folder's name with --ros2: a bag is a folder" in reported


def test_a_reference_without_sigma_has_none_afterwards(tmp_path: Path) -> None:
    session = Tiny(rows=3, video="png").write(tmp_path / "session")
    (session / "dgps.csv").write_text("t_s,x_m,y_m,z_m\n1.0,0,300,20\n1.1,0,299,20\n")
    assert main(["convert", str(session), str(tmp_path / "bag"), "--ros2"]) == 0
    assert main(["convert", str(tmp_path / "bag"), str(tmp_path / "back")]) == 0
    assert [fix.sigma_m for fix in load_dgps(load_session(tmp_path / "back"))] == [None, None]


def test_a_camera_of_one_frame_has_no_interval() -> None:
    """Expected: its frame is in the row of its time; it decided how close others had to be, and none ever was."""
    stamps = {"left": np.array([1.2]), "right": 1.0 + 0.1 * np.arange(4)}
    rows = list(itertools.islice(frames_rows(stamps), 9))
    assert [sorted(row) for row in rows] == [["right"], ["right"], ["left", "right"], ["right"]]
    assert list(frames_rows({"left": np.array([1.0]), "right": np.array([1.02])})) == [{"left": 1.0, "right": 1.02}]


@pytest.mark.parametrize("seen", [0, 1])
def test_a_camera_that_missed_a_part_is_in_the_folder_of_its_bag(tmp_path: Path, seen: int) -> None:
    """Expected: of no frame of one camera, or of a single one, the folder is that which was written."""
    names, stamps = ("left", "right", "third"), [1.0 if seen else None, None, None, None]
    session = Tiny(names=names, fixed=names, rows=4, video="png", stamps={"left": stamps}).write(tmp_path / "session")
    assert main(["convert", str(session), str(tmp_path / "bag"), "--ros2"]) == 0
    assert main(["convert", str(tmp_path / "bag"), str(tmp_path / "back")]) == 0
    given, back = in_order(streamed(session)), in_order(streamed(tmp_path / "back"))
    assert sum(isinstance(event, Frame) for event in given) == 8 + seen
    assert all(nearly_same(one, two) for one, two in zip(given, back, strict=True))


def test_the_clock_of_the_reference_is_applied_once(tmp_path: Path) -> None:
    """Expected: the fixes' times of the session's DGPS clock, in the bag and in the folder that it becomes again."""
    clocks = "\n[clocks]\ndgps = { offset_s = 0.3, drift_ppm = 50.0 }\n"
    session = Tiny(rows=3, video="png", session=SESSION + clocks).write(tmp_path / "session")
    (session / "dgps.csv").write_text(DGPS)
    assert main(["convert", str(session), str(tmp_path / "bag"), "--ros2"]) == 0
    assert main(["convert", str(tmp_path / "bag"), str(tmp_path / "back")]) == 0
    given, back = ([fix.t_s for fix in load_dgps(load_session(tmp_path / f))] for f in ("session", "back"))
    assert given == pytest.approx([1.30005, 1.400055], abs=1e-9)
    assert back == pytest.approx(given, abs=2e-9)
    with AnyReader([tmp_path / "bag"]) as reader:
        stamps_ns = [ns for connection, ns, _ in reader.messages() if connection.topic == "/reference"]
    assert stamps_ns == [1_300_050_000, 1_400_055_000]


def test_pixels_go_both_ways(tmp_path: Path) -> None:
    first = Tiny(rows=5, video="").write(tmp_path / "first")
    (first / "frames.csv").unlink()
    rows = [f"{1.0 + 0.1 * k},{n},{30 + k}.25,20.125" for k in range(8) for n in ("left", "right")]
    (first / "detections.csv").write_text("\n".join(["t_s,station,u_px,v_px", *rows]) + "\n")
    bag, second = tmp_path / "bag", tmp_path / "second"
    assert main(["convert", str(first), str(bag), "--ros2"]) == 0
    assert main(["convert", str(bag), str(second)]) == 0
    given, back = in_order(streamed(first)), in_order(streamed(second))
    assert all(nearly_same(one, two) for one, two in zip(given, back, strict=True))


@pytest.mark.parametrize(("span", "count"), [(["--from", "1.3"], 0), (["--to", "1.3"], 1)])
def test_the_track_is_cut_as_the_session_is(
    written: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], span: list[str], count: int
) -> None:
    """The run's one estimate is at 1.1 s."""
    session, _ = written
    run = session.parent / "run"
    assert main(["convert", str(session), str(tmp_path / "ros"), "--ros2", "--run", str(run), *span]) == 0
    assert f"{count} estimates of {run} are on /track" in capsys.readouterr().out
