import errno
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.cli.main import main
from groundstation.errors import InputError, SessionError
from groundstation.rig.rig import ClockModel
from groundstation.session import MediumKind, load_session
from groundstation.session.load import LIVE_RECORDING
from tests.complaints import complaint, only
from tests.mutation import damaged
from tests.session.folder import SESSION, Tiny, replace_in, rig_text, write_video

FULL = """name = "full"
origin = "a meadow"
date = 2024-05-17
licence = "CC0"
notes = "gusts"
frame = "east-north-up"
weather = { wind_m_s = 3.0 }

[clocks]
left = { offset_s = 61.95, sigma_s = 0.3 }
right = { offset_s = -3.0 }
ptu = { offset_s = 60.0 }

[target]
span_m = 2.3
antenna_in_body_m = [-0.4, 0.0, -0.1]

[initial]
t_s = 1.0
position_m = [0, 300, 20]
velocity_m_s = [0, -15, -1]
sigma_position_m = [1, 5, 1]
sigma_velocity_m_s = 2

[[phase]]
from_s = 0.5
to_s = 2
background = "sky"
"""


def session_of(folder: Path, text: str, **tiny: object):
    return load_session(Tiny(video="png", rows=1, session=text, **tiny).write(folder))


def test_every_key_of_a_session(tmp_path: Path) -> None:
    session = session_of(tmp_path, FULL)
    assert (session.name, session.frame, session.has_clocks) == ("full", "east-north-up", True)
    assert session.target.span_m == 2.3
    assert session.target.antenna_in_body_m is not None
    assert session.origin is None  # a sentence about where it comes from is no place on Earth
    assert session.initial is not None
    assert session.initial.position_runway_m.tolist() == [0.0, 300.0, 20.0]
    assert session.initial.sigma_velocity_m_s.tolist() == [2.0, 2.0, 2.0]
    assert [(p.from_s, p.to_s, p.background) for p in session.phases] == [(0.5, 2.0, "sky")]
    assert session.clocks["left"] == ClockModel(offset_s=61.95, sigma_s=0.3)
    assert (session.date, session.licence, session.notes) == ("2024-05-17", "CC0", "gusts")
    assert not session.detections_only


def test_an_origin_with_coordinates(tmp_path: Path) -> None:
    text = "[origin]\nlat_deg = 47.4\nlon_deg = 8.5\nheight_m = 455.0\ny_axis_azimuth_deg = 270\n"
    origin = session_of(tmp_path, text).origin
    assert origin is not None
    assert (origin.lat_deg, origin.y_axis_azimuth_deg) == (47.4, 270.0)
    # a runway's direction must be given; where y is north, it need not
    no_azimuth = text.replace("y_axis", "# y_axis")
    reported = complaint(SessionError, lambda: session_of(tmp_path / "none", no_azimuth))
    assert "origin: y_axis_azimuth_deg: got nothing; wanted a finite number" in reported
    north = session_of(tmp_path / "enu", 'frame = "east-north-up"\n' + no_azimuth, names=("left",)).origin
    assert north is not None
    assert north.y_axis_azimuth_deg == 0.0
    reported = complaint(SessionError, lambda: session_of(tmp_path / "far", text.replace("47.4", "91")))
    assert "origin: lat_deg: got 91; wanted a finite number ≥ -90 ≤ 90" in reported


def test_an_empty_session_file_is_enough(tmp_path: Path) -> None:
    session = session_of(tmp_path / "landing-7", "")
    assert (session.name, session.frame, session.initial, session.phases) == ("landing-7", "runway", None, ())
    assert not session.has_clocks


def test_clocks_in_the_order_of_their_authority(tmp_path: Path) -> None:
    more = {"right": "camera_clock = { offset_s = 7.0 }\nptu_clock = { offset_s = 8.0 }"}
    session = session_of(tmp_path, FULL, rig_more=more)
    left, right = session.rig.stations
    assert session.camera_clock(left).offset_s == 61.95
    assert session.camera_clock(right).offset_s == 7.0
    assert session.ptu_clock(left).offset_s == 60.0
    assert session.ptu_clock(right).offset_s == 8.0


def test_the_rigs_clock_takes_precedence_even_if_zero(tmp_path: Path) -> None:
    more = {"right": "camera_clock = { offset_s = 0.0 }\nptu_clock = { offset_s = 0.0 }"}
    session = session_of(tmp_path, FULL, rig_more=more)
    right = session.rig["right"]
    assert session.camera_clock(right) == session.ptu_clock(right) == ClockModel()
    # the pipeline takes a clock's sigma from the rig
    assert session.rig["left"].camera_clock == ClockModel(offset_s=61.95, sigma_s=0.3)
    assert session.rig["left"].ptu_clock == ClockModel(offset_s=60.0)


def test_a_clock_of_all_frames(tmp_path: Path) -> None:
    session = session_of(tmp_path, "[clocks]\nframes = { offset_s = 4.0 }\nright = { offset_s = 5.0 }\n")
    assert [session.camera_clock(s).offset_s for s in session.rig.stations] == [4.0, 5.0]
    assert session.has_clocks
    assert not session_of(tmp_path / "b", "[clocks]\nptu = { offset_s = 4.0 }\n").has_clocks


def test_without_clocks_all_files_share_one(tmp_path: Path) -> None:
    session = session_of(tmp_path, SESSION)
    assert session.camera_clock(session.rig["left"]) == ClockModel() == session.ptu_clock(session.rig["left"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"east-north-up"', '"north"', "session.toml: frame: got 'north'; wanted 'runway' or 'east-north-up'"),
        ("span_m = 2.3", "span_m = 2300", "target: span_m: got 2300; wanted a finite number > 0 ≤ 200"),
        ("span_m = 2.3", "span_m = 0", "session.toml: target: span_m: got 0; wanted a finite number > 0"),
        ("span_m", "wing_m", "target: wing_m: got an unknown key; wanted one of antenna_in_body_m, span_m"),
        ("left = {", "middle = {", "clocks: middle: got an unknown clock; wanted a station (left, right) or"),
        ("offset_s = 61.95, sigma_s", "sigma_s", "clocks: left: offset_s: got nothing; wanted a finite number"),
        ("offset_s = -3.0", "offset_s = nan", "clocks: right: offset_s: got nan; wanted a finite number"),
        ("offset_s = -3.0", "offset_s = 1, rate = 2", "clocks: right: rate: got an unknown key"),
        ("[1, 5, 1]", "[1, 0, 1]", "initial: sigma_position_m: got [1.0, 0.0, 1.0]; wanted numbers > 0"),
        ("t_s = 1.0", "", "initial: t_s: got nothing; wanted a finite number"),
        ("velocity_m_s = [0, -15, -1]", "speed = 3", "initial: speed: got an unknown key"),
        ("to_s = 2", "to_s = 0", "phase 1: to_s: got 0; wanted at least from_s = 0.5"),
        ('"sky"', '"clouds"', "phase 1: background: got 'clouds'; wanted 'sky', 'mixed' or 'ground'"),
        ("[[phase]]", "[phase]", "phase: got {'from_s': 0.5"),
        ("[initial]", "[intial]", "intial: got an unknown table; wanted [initial], if that is what is meant"),
        (
            "licence",
            'format = "stereo-ptu-rig/1"\nlicence',
            "format: got 'stereo-ptu-rig/1'; wanted a session's description",
        ),
        ("[[phase]]", "[[phases]]", "phases: got an unknown table; wanted [phase]"),
        ("[target]", "target", "got not TOML"),
    ],
)
def test_a_fault_in_session_toml_names_table_and_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in FULL
    reported = complaint(SessionError, lambda: session_of(tmp_path, FULL.replace(old, new, 1)))
    assert reported.startswith(str(tmp_path / "session.toml"))
    assert message in reported


@pytest.mark.parametrize("name", ["session.toml", "rig.toml"])
def test_a_missing_document(tmp_path: Path, name: str) -> None:
    folder = Tiny(video="png", rows=1).write(tmp_path)
    (folder / name).unlink()
    assert (
        complaint(InputError, lambda: load_session(folder)) == f"{folder / name}: got no such file; wanted a TOML file"
    )


def test_a_missing_folder(tmp_path: Path) -> None:
    reported = complaint(SessionError, lambda: load_session(tmp_path / "nowhere"))
    assert reported.endswith("nowhere: got no such folder; wanted a session folder with session.toml")


def test_another_rig_than_the_sessions_own(tmp_path: Path) -> None:
    folder = Tiny(video="png", rows=1).write(tmp_path / "a")
    replace_in(folder / "rig.toml", "[-5.0, 0.0, 1.5]", "[-6.0, 0.0, 1.5]")
    (folder / "rig.toml").rename(tmp_path / "other.toml")
    assert load_session(folder, tmp_path / "other.toml").rig["left"].ptu_position_m[0] == -6.0


def test_a_rig_of_some_of_the_stations(tmp_path: Path) -> None:
    """Expected: what the folder's own rig has beyond it is passed over; what neither has is a slip."""
    clocks = "[clocks]\nleft = { offset_s = 1.0 }\nthird = { offset_s = 2.0 }\n"
    folder = Tiny(video="png", rows=1, names=("left", "right", "third"), session=clocks).write(tmp_path / "a")
    (tmp_path / "two.toml").write_text(rig_text(("left", "right")))
    session = load_session(folder, tmp_path / "two.toml")
    assert session.left_out == {"third"}
    assert session.rig.names == ("left", "right")
    (folder / "rig.toml").write_text(rig_text(("left", "right")))
    assert "clocks: third: got an unknown clock" in complaint(SessionError, lambda: load_session(folder))


# ------------------------------------------------------------------------------- checks of loading
@pytest.mark.parametrize(
    ("table", "column"), [("frames.csv", "right_t_s"), ("frames.csv", "index"), ("ptu.csv", "left_tilt_deg")]
)
def test_a_missing_column_is_known_at_once(tmp_path: Path, table: str, column: str) -> None:
    folder = Tiny(video="png", rows=1).write(tmp_path)
    replace_in(folder / table, column, "other")
    reported = complaint(SessionError, lambda: load_session(folder))
    assert reported.startswith(f"{table}: line 1: got ")
    assert reported.endswith(f"; wanted a column {column}")


def test_missing_tables_are_known_at_once(tmp_path: Path) -> None:
    folder = Tiny(video="png", rows=1).write(tmp_path)
    (folder / "ptu.csv").unlink()
    reported = complaint(SessionError, lambda: load_session(folder))
    assert reported == f"{folder / 'ptu.csv'}: got no such file; wanted a table with " + ", ".join(
        ["t_s", "left_pan_deg", "left_tilt_deg", "right_pan_deg", "right_tilt_deg"]
    )
    replace_in(folder / "rig.toml", "fixed = false", "fixed = true")
    replace_in(folder / "rig.toml", "fixed = false", "fixed = true")
    assert load_session(folder).rig["right"].fixed


def test_a_video_that_is_none_is_known_at_once(tmp_path: Path) -> None:
    folder = Tiny(rows=3).write(tmp_path)
    (folder / "right.avi").write_bytes(b"RIFF, but no more")
    reported = complaint(SessionError, lambda: load_session(folder))
    assert reported == "right.avi: got no video that OpenCV can open; wanted a complete video file"


def test_a_video_of_an_unusual_kind(tmp_path: Path) -> None:
    folder = Tiny(rows=3).write(tmp_path)
    (folder / "right.avi").rename(folder / "right.recording")
    assert load_session(folder).media["right"].path.name == "right.recording"


# ------------------------------------------------------------------------------------------------ media
def test_videos_folders_and_their_names(tmp_path: Path) -> None:
    folder = Tiny(video="png", rows=1, names=("left", "right", "third")).write(tmp_path)
    write_video(folder / "third.AVI", [0])
    (folder / "left.txt").write_text("a note")
    media = load_session(folder).media
    assert [media[n].kind for n in ("left", "right", "third")] == [
        MediumKind.IMAGES,
        MediumKind.IMAGES,
        MediumKind.VIDEO,
    ]
    assert media["third"].path.name == "third.AVI"


def test_a_station_without_pictures(tmp_path: Path) -> None:
    folder = Tiny(rows=1).write(tmp_path)
    (folder / "right.avi").unlink()
    assert "got no pictures of station right; wanted right.mp4" in complaint(SessionError, lambda: load_session(folder))


def test_two_videos_of_one_station(tmp_path: Path) -> None:
    folder = Tiny(rows=1).write(tmp_path)
    (folder / "left.mp4").write_bytes(b"")
    reported = complaint(SessionError, lambda: load_session(folder))
    assert reported.endswith("got left.avi and left.mp4; wanted one video for station left")


def test_neither_frames_nor_detections(tmp_path: Path) -> None:
    folder = Tiny(rows=1).write(tmp_path)
    (folder / "frames.csv").unlink()
    wanted = "wanted frames.csv with videos, or detections.csv"
    assert complaint(SessionError, lambda: load_session(folder)).endswith(f"got pictures without frames.csv; {wanted}")
    for name in ("left.avi", "right.avi"):
        (folder / name).unlink()
    assert complaint(SessionError, lambda: load_session(folder)).endswith(f"got neither of them; {wanted}")


def test_detections_replace_pictures(tmp_path: Path) -> None:
    folder = Tiny(rows=1, video="none").write(tmp_path)
    (folder / "detections.csv").write_text("t_s,station,u_px,v_px\n")
    assert load_session(folder).media == {}
    (folder / "frames.csv").unlink()
    assert load_session(folder).media == {}


def test_the_bundled_session(landing_1: Path) -> None:
    session = load_session(landing_1)
    assert session.name == "landing-1"
    assert session.target.span_m == 2.3
    assert [p.background for p in session.phases] == ["sky", "mixed", "ground"]
    assert session.media["left"].path.name == "left.mp4"


def test_a_labelled_recording_of_four_fixed_stations(shared_data: Path) -> None:
    session = load_session(shared_data / "drone-flight-3")
    assert session.rig.names == ("gopro3", "sony5n", "sony5100", "sonyG")
    assert session.has_clocks
    assert session.media == {}
    assert np.isclose(session.camera_clock(session.rig["sonyG"]).offset_s, 58.88)
    assert "calibrate flight" in complaint(InputError, session.rig.require_known)


@settings(max_examples=80)
@given(st.one_of(st.binary(max_size=80), damaged(FULL)))
def test_arbitrary_bytes_raise_only_project_errors(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    folder = tmp_path_factory.getbasetemp() / "session"
    if not folder.is_dir():
        Tiny(rows=1, video="png").write(folder)
    (folder / "session.toml").write_bytes(content)
    with only(InputError):
        load_session(folder)


def test_the_folder_of_a_live_run_is_its_recording(tmp_path: Path) -> None:
    """Expected: as `replay` and `convert` get it; a folder that is a session of its own stays one."""
    session, live = Tiny(rows=3).write(tmp_path / "session"), tmp_path / "live"
    live.mkdir()
    assert main(["convert", str(session), str(live / LIVE_RECORDING)]) == 0
    recorded = load_session(live).recorded
    assert recorded is not None
    assert recorded.path == live / LIVE_RECORDING
    assert main(["replay", str(live), "--out", str(tmp_path / "out"), "--no-rerun"]) == 0
    assert main(["convert", str(live), str(tmp_path / "back")]) == 0
    assert load_session(tmp_path / "back").recorded is None
    (session / LIVE_RECORDING).write_bytes((live / LIVE_RECORDING).read_bytes())
    assert load_session(session).recorded is None


@pytest.mark.parametrize("name", ["", "left.avi"])
def test_what_may_not_be_read_is_called_so(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: of a folder and of a video, of which OpenCV says nothing; the tests may run as root, who reads all."""
    folder = Tiny(rows=2).write(tmp_path / "session")
    before = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != folder / name and before(path, mode))
    reported = complaint(SessionError, lambda: load_session(folder))
    wanted = "a file" if name else "a folder"
    assert reported == f"{name or folder}: got {os.strerror(errno.EACCES)}; wanted {wanted} that can be read"


@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_one_video_for_two_stations_is_refused(tmp_path: Path, link: Callable[[Path, Path], None]) -> None:
    folder = Tiny(rows=3, video="avi").write(tmp_path)
    load_session(folder)
    (folder / "right.avi").unlink()
    link(folder / "right.avi", folder / "left.avi")
    reported = complaint(SessionError, lambda: load_session(folder))
    assert reported == "left.avi, right.avi: got one file for left and right; wanted each station's own video"


@pytest.mark.parametrize("name", ["bag.mcap", "bag_0.db3"])
def test_a_bag_without_its_metadata_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"")
    reported = complaint(SessionError, lambda: load_session(tmp_path))
    assert f"got {name} and neither session.toml nor metadata.yaml; wanted a session folder, or a ROS 2 bag" in reported


def test_a_link_to_nowhere_is_named(tmp_path: Path) -> None:
    folder = Tiny(rows=3, video="avi").write(tmp_path)
    (folder / "right.avi").unlink()
    (folder / "right.avi").symlink_to("/media/usb/right.avi")
    reported = complaint(SessionError, lambda: load_session(folder))
    assert (
        "got no pictures of station right (right.avi is a link to /media/usb/right.avi, which is not there)" in reported
    )
