"""Videos, a log and tables made into a session that replays; what cannot be right refused, with nothing written."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.cli.main import main
from groundstation.conversion.import_session import _behind
from groundstation.conversion.video_frame_pairing import frames_csv
from groundstation.conversion.video_stamps import read_video_stamps
from groundstation.errors import InputError
from groundstation.messages import DgpsFix
from groundstation.rig.rig import load_rig
from groundstation.session import load_dgps, load_session
from groundstation.sources.frame_table import read_frames
from tests.complaints import complaint
from tests.session.folder import number_of, rig_text, write_video
from tests.session.logs.writers import Place, nmea_log
from tests.sources.events import play

DATA = Path(__file__).parents[1] / "session" / "logs" / "data"
PLACE = "35.68,139.76,60"
# the writers' first fix is at 11:59:52
STARTS = ("2025-05-08T11:59:51.500Z", "2025-05-08T11:59:51.830Z")


@pytest.fixture
def parts(tmp_path: Path) -> Path:
    """What a flight left: left 20 frames, right 17 frames at 10 Hz, angles, a log at 5 Hz."""
    write_video(tmp_path / "L.avi", range(20))
    write_video(tmp_path / "R.avi", range(17))
    (tmp_path / "rig.toml").write_text(rig_text(("left", "right")))
    rows = [f"{0.05 * k:.2f},0,1,2,3" for k in range(60)]
    head = "t_s,left_pan_deg,left_tilt_deg,right_pan_deg,right_tilt_deg\n"
    (tmp_path / "angles.csv").write_text(head + "\n".join(rows) + "\n")
    (tmp_path / "flight.nmea").write_bytes(nmea_log([Place(0.2 * k) for k in range(8)]))
    return tmp_path


def run(parts: Path, *more: str, without: tuple[str, ...] = ()) -> int:
    words = {
        "--rig": str(parts / "rig.toml"),
        "--ptu": str(parts / "angles.csv"),
        "--dgps": str(parts / "flight.nmea"),
        "--origin": PLACE,
        "--azimuth": "0",
        "--left-start": STARTS[0],
        "--right-start": STARTS[1],
        "--out": str(parts / "session"),
    }
    given = [w for k, v in words.items() if k not in (*without, *more) for w in (k, v)]
    return main(["import", str(parts / "L.avi"), str(parts / "R.avi"), *given, *more])


def three(folder: Path, frames: dict[str, int]) -> Path:
    """Three fixed stations, and a video of each with so many frames at 10 Hz."""
    (folder / "rig.toml").write_text(rig_text(tuple(frames), fixed=tuple(frames)))
    for name, count in frames.items():
        write_video(folder / f"{name}.avi", range(count))
    return folder


def import_three(folder: Path, order: tuple[str, ...], starts: dict[str, float]) -> int:
    files = [str(folder / f"{name}.avi") for name in order]
    given = [w for name, t in starts.items() for w in ("--start", f"{name}=2026-05-17T09:30:{t:04.1f}Z")]
    return main(["import", *files, "--rig", str(folder / "rig.toml"), "--out", str(folder / "session"), *given])


def test_videos_named_after_stations_are_theirs_in_any_order(tmp_path: Path) -> None:
    """Expected: not those of the rig's order, as a shell's *.avi is in order of the alphabet."""
    folder = three(tmp_path, {"west": 12, "east": 15, "mid": 18})
    assert import_three(folder, ("east", "mid", "west"), {"west": 0.0, "east": 0.0, "mid": 0.0}) == 0
    for name, count in (("west", 12), ("east", 15), ("mid", 18)):
        assert len(read_video_stamps(folder / "session" / f"{name}.avi").t_s) == count


def test_one_of_three_cameras_may_end_before_another_starts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: pairs with the third one, all through; a camera that ran with none of them is refused."""
    folder = three(tmp_path, {"west": 10, "east": 10, "mid": 30})
    assert import_three(folder, ("west", "east", "mid"), {"west": 0.0, "east": 1.5, "mid": 0.0}) == 0
    assert "20 pairs of frames, of 30" in capsys.readouterr().out
    shutil.rmtree(folder / "session")
    assert import_three(folder, ("west", "east", "mid"), {"west": 0.0, "east": 5.0, "mid": 0.0}) == 1
    assert "videos that ran at the same time" in capsys.readouterr().err


def test_an_import_replays_with_each_cameras_own_frames(parts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(parts, "--span", "2.3", "--antenna", "-0.4,0,-0.1") == 0
    printed = capsys.readouterr()
    assert "17 pairs of frames, of 20" in printed.out
    assert "flight.nmea: 8 positions, 8 while the cameras ran (8 fix), 121 to 121 m from the origin" in printed.out
    session = load_session(parts / "session")
    assert session.target.span_m == 2.3
    assert session.target.antenna_in_body_m == pytest.approx([-0.4, 0.0, -0.1])
    fixes = load_dgps(session)
    assert [f.t_s for f in fixes] == pytest.approx(1.0 + 0.2 * np.arange(8), abs=1e-6)
    assert fixes[0].position_runway_m == pytest.approx([45.26, 110.95, 15.01], abs=0.02)
    assert (fixes[0].status, fixes[0].sigma_m) == ("fix", pytest.approx([0.02, 0.02, 0.04]))
    played = play(parts / "session")
    assert not played.fault
    for name, start in (("left", 0.5), ("right", 0.83)):
        frames = played.delivered_frames(name)
        # 10 Hz: the picture's own number gives its time
        assert [f.t_s for f in frames] == pytest.approx(
            [start + 0.1 * number_of(f.image.whole()) for f in frames], abs=1e-6
        )
        assert [number_of(f.image.whole()) for f in frames] == list(range(20 if name == "left" else 17))
    both = [e for e in played.epochs if len(e.stations) == 2]
    assert len(both) == 17


def test_positions_elsewhere_are_told_before_the_videos_are_read(
    parts: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delattr("groundstation.conversion.import_session.read_video_stamps")
    assert run(parts, "--origin", "47,8,400") == 1
    assert "km and more from the origin" in capsys.readouterr().err


def test_a_runway_in_the_wrong_direction_is_reported(parts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: positions behind the cameras are reported with the azimuth that puts them in front; others are not."""
    reported = []
    for azimuth in ("0", "180"):
        assert run(parts, "--azimuth", azimuth, "--out", str(parts / f"runway-{azimuth}")) == 0
        reported.append([line for line in capsys.readouterr().err.splitlines() if "behind the stations" in line])
    assert reported[0] == []
    (line,) = reported[1]
    assert "8 of 8 positions lie behind the stations at --azimuth 180; " in line
    assert line.endswith("it is --azimuth 0")


def test_the_geoid_separation_is_kept_for_maps_of_the_track(parts: Path) -> None:
    assert run(parts, "--geoid-separation", "47.5") == 0
    session = load_session(parts / "session")
    assert session.dgps.reading.geoid_separation_m == 47.5
    # the log itself states its own, and its positions are where they were
    assert load_dgps(session)[0].position_runway_m == pytest.approx([45.26, 110.95, 15.01], abs=0.02)


def test_links_and_a_part_of_it(parts: Path) -> None:
    assert run(parts, "--link") == 0
    assert (parts / "session" / "left.avi").is_symlink()
    played = play(parts / "session", 1.0, 1.3)
    assert [number_of(f.image.whole()) for f in played.delivered_frames("right")] == [2, 3, 4]


def test_uneven_stamps_are_the_containers(parts: Path) -> None:
    video = read_video_stamps(DATA / "uneven.mkv")
    assert video.t_s == pytest.approx([0, 0.033, 0.067, 0.1, 0.133, 0.3, 0.333, 0.367, 0.4, 0.433, 0.467], abs=1e-6)
    assert video.summary() == "uneven.mkv: 11 frames in 0.47 s, one each 33.00 ms, 1 gaps up to 0.167 s"


def test_one_video_for_two_stations_is_refused(parts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (parts / "R.avi").unlink()
    (parts / "R.avi").symlink_to("L.avi")
    assert run(parts) == 1
    assert "R.avi: got one video for left and right; wanted each station's own" in capsys.readouterr().err
    assert not (parts / "session").exists()


USAGE = ("--left-start: ", "--right-start: ", "--epoch: ")


@pytest.mark.parametrize(
    ("more", "without", "message"),
    [
        (("--left-start", "noon"), (), "--left-start: got 'noon'; wanted UTC such as"),
        ((), ("--right-start",), "--right-start: got no start of right's video; wanted UTC such as"),
        (("--right-start", "2025-05-08T12:59:51Z"), (), "the videos: got left from 0.50 to 2.40 s, right from 3600.00"),
        ((), ("--ptu",), "--ptu: got nothing; wanted the table of angles of the stations that turn"),
        (("--ptu-start", "2025-05-08T13:00:00Z"), (), "wanted some while the cameras ran, 0.50 to 2.43 s"),
        ((), ("--origin",), "flight.nmea: got no --origin; wanted where the session's frame lies"),
        ((), ("--azimuth",), "flight.nmea: got no --azimuth"),
        (("--origin", "47,8,400"), (), "km and more from the origin"),
        (("--date", "2025-05-08"), (), ""),
        (("--date", "2025-05-09"), (), "got positions of 2025-05-08; wanted 2025-05-09, the date given for it"),
        (("--date", "2025-07-09"), (), "got positions of 2025-05-08; wanted 2025-07-09"),
        (
            ("--left-start", "2025-05-08T11:00:51.5Z", "--right-start", "2025-05-08T11:00:51.5Z"),
            (),
            "flight.nmea: got positions from 2025-05-08T11:59:52Z to 2025-05-08T11:59:53.400Z",
        ),
        (("--dgps", "none.nmea"), (), "none.nmea: got no such file; wanted a log of positions"),
        (("--epoch", "now"), (), "--epoch: got 'now'; wanted UTC such as"),
        (("--start", "third=1"), (), "--start: got station 'third'; wanted one of left, right"),
    ],
)
def test_what_cannot_be_right_is_one_line_and_no_folder(
    parts: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], without: tuple[str, ...], message: str
) -> None:
    code = run(parts, *more, without=without)
    printed = capsys.readouterr().err
    if not message:
        # a day off is no other date: the log may begin before midnight
        assert code == 0
        return
    # of the arguments alone, or with what the files hold
    assert code == (2 if message.startswith(USAGE) else 1)
    assert message in printed
    assert "Traceback" not in printed
    assert not (parts / "session").exists()
    assert not (parts / "session.partial").exists()


def test_other_refusals(parts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (parts / "rig.toml").write_text(rig_text(("left", "right", "third")))
    assert run(parts) == 1
    assert "VIDEO: got 2 videos; wanted 3, of the stations left, right, third" in capsys.readouterr().err
    (parts / "rig.toml").write_text(rig_text(("left", "right")).replace("[64, 48]", "[640, 480]"))
    assert main(["import", "L.avi", "--rig", str(parts / "rig.toml"), "--out", str(parts / "session")]) in (1, 2)
    assert "got 1 video; wanted 2" in capsys.readouterr().err
    assert run(parts) == 1
    assert "L.avi: got 64×48 px; wanted 640×480 px, as station left has in the rig" in capsys.readouterr().err
    (parts / "rig.toml").write_text(rig_text(("left", "right")))
    (parts / "session").mkdir()
    (parts / "session" / "precious").write_text("x")
    assert run(parts) == 1
    assert "got something that is there already" in capsys.readouterr().err
    shutil.rmtree(parts / "session")
    (parts / "L.avi").write_bytes(b"RIFF")
    assert run(parts) == 1
    assert "L.avi: got no video that OpenCV can open" in capsys.readouterr().err
    for option, value, wanted in (
        ("--origin", "95,0,0", "wanted latitude, longitude in degrees"),
        ("--azimuth", "400", "got '400'; wanted degrees clockwise from true north, -360 to 360"),
    ):
        with pytest.raises(SystemExit) as wrong:
            run(parts, option, value)
        assert wrong.value.code == 2
        assert wanted in capsys.readouterr().err


def test_offsets_a_frame_table_and_no_log(parts: Path) -> None:
    assert run(parts, "--left-start", "0", "--right-start", "0.33", "--ptu-start", "0", without=("--dgps",)) == 0
    table = read_frames(load_session(parts / "session"))
    assert table.stamps_s["left"][0] == 0.0
    shutil.copy(parts / "session" / "frames.csv", parts / "times.csv")
    shutil.rmtree(parts / "session")
    starts = ("--left-start", "--right-start")
    assert run(parts, "--frames", str(parts / "times.csv"), without=(*starts, "--dgps")) == 0
    again = read_frames(load_session(parts / "session"))
    np.testing.assert_array_equal(again.numbers["right"], table.numbers["right"])
    shutil.rmtree(parts / "session")
    # a log in UTC next to times of an unknown clock
    assert run(parts, "--frames", str(parts / "times.csv"), without=starts) == 2
    # times of the table and a start say two things
    assert run(parts, "--frames", str(parts / "times.csv"), without=("--dgps",)) == 2


HEAD = "left_pan_deg,left_tilt_deg,right_pan_deg,right_tilt_deg"


@pytest.mark.parametrize(
    ("table", "more", "message"),
    [
        ("index,left_t_s,right_t_s\n0,0.5,0.5\n", (), "angles.csv: line 1: got index, left_t_s, right_t_s; wanted"),
        (
            f"t_s;{HEAD.replace(',', ';')}\n0,5;0;1;2;3\n",
            (),
            "got cells separated by semicolons; wanted commas between",
        ),
        (f"t_s,{HEAD}\n0.5,0,1,2,3\n0.4,0,1,2,3\n", (), "line 3: got t_s = 0.4, an earlier time than the row before"),
        (
            f"unix_s,{HEAD}\n1746705591500,0,1,2,3\n",
            (),
            "line 2: got unix_s = '1746705591500', which would be a time of our days in milliseconds; wanted seconds",
        ),
        (
            f"unix_s,{HEAD}\n1746705591500000000,0,1,2,3\n",
            (),
            "which would be a time of our days in nanoseconds; wanted seconds since 1970",
        ),
        (None, ("--span", "230"), "--span, --antenna: span_m: got 230.0; wanted a finite number > 0 ≤ 200"),
        (None, ("--antenna", "-400,0,-100"), "--span, --antenna: antenna_in_body_m: got [-400.0, 0.0, -100.0]; wanted"),
        (
            None,
            ("--antenna", "-40,0,-10", "--span", "2.3"),
            "antenna_in_body_m: got [-40.0, 0.0, -10.0]; wanted metres from the nose, on an aircraft of 2.3 m span",
        ),
    ],
)
def test_what_cannot_be_right_is_told_before_the_videos_are_read(
    parts: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    table: str | None,
    more: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.delattr("groundstation.conversion.import_session.read_video_stamps")
    if table is not None:
        (parts / "angles.csv").write_text(table)
    assert run(parts, *more) == 1
    assert message in capsys.readouterr().err


def test_angles_of_a_local_time_are_named(parts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(parts, "--ptu-start", "2025-05-08T13:59:51Z") == 1
    printed = capsys.readouterr().err
    assert "got angles from 7200.00 to 7202.95 s, which would fit 2 h earlier: a local time?; wanted some" in printed


def test_an_azimuth_in_radians_is_named(parts: Path) -> None:
    """Expected: of positions that lie ahead at 200°, and behind at 3.49°."""
    fixes = [DgpsFix(t_s=float(k), position_runway_m=np.array([0.0, -300.0, 20.0])) for k in range(4)]
    rig = load_rig(parts / "rig.toml")
    (note,) = _behind(fixes, rig, 3.4906585, "flight.nmea")
    assert note.endswith("lie behind the stations at --azimuth 3.49066; if that is in radians, it is --azimuth 200")
    (note,) = _behind(fixes, rig, 0.1, "flight.nmea")
    assert note.endswith("if the runway is the other way round, it is --azimuth 180.1")


def test_videos_called_as_the_other_station_are_noted(parts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (parts / "L.avi").rename(parts / "right.avi")
    (parts / "R.avi").rename(parts / "Left.avi")
    for one, other in (("L", "right"), ("R", "Left")):
        (parts / f"{one}.avi").symlink_to(f"{other}.avi")
    assert run(parts) == 0
    assert "is given as" not in capsys.readouterr().err
    shutil.rmtree(parts / "session")
    for link in "LR":
        (parts / f"{link}.avi").unlink()
    words = ["--rig", parts / "rig.toml", "--ptu", parts / "angles.csv", "--out", parts / "session"]
    starts = ["--left-start", "0", "--right-start", "0"]
    assert main(["import", str(parts / "right.avi"), str(parts / "Left.avi"), *map(str, words), *starts]) == 0
    printed = capsys.readouterr().err
    assert "right.avi is given as the video of left: is it that of right?" in printed
    assert "Left.avi is given as the video of right: is it that of left?" in printed


def test_angles_in_utc_and_unix_time(parts: Path) -> None:
    for head, first in (("utc", "2025-05-08T11:59:51.5Z"), ("unix_s", "1746705591.5")):
        text = f"{head},left_pan_deg,left_tilt_deg,right_pan_deg,right_tilt_deg\n{first},0,1,2,3\n"
        (parts / "angles.csv").write_text(text)
        assert run(parts) == 0
        assert (parts / "session" / "ptu.csv").read_text().splitlines()[1] == "0.500000,0,1,2,3"
        shutil.rmtree(parts / "session")


def test_stamps_that_do_not_grow(parts: Path) -> None:
    write_video(parts / "one.avi", range(1))
    assert "one.avi: got 1 frames" in complaint(InputError, lambda: read_video_stamps(parts / "one.avi"))
    assert "got no such file" in complaint(InputError, lambda: read_video_stamps(parts / "none.avi"))


@given(
    st.lists(st.floats(0.02, 0.3), min_size=2, max_size=30),
    st.lists(st.floats(0.02, 0.3), min_size=2, max_size=30),
    st.floats(-1, 1),
)
def test_every_frame_is_in_one_row(left: list[float], right: list[float], shift: float) -> None:
    stamps = {"left": np.cumsum(left), "right": np.cumsum(right) + shift}
    rows = [line.split(",") for line in frames_csv(stamps).splitlines()]
    assert rows[0] == ["index", "left_t_s", "right_t_s", "left_index", "right_index"]
    tolerance = 0.5 * min(np.median(np.diff(t)) for t in stamps.values())
    for place, name in ((3, "left"), (4, "right")):
        assert [int(r[place]) for r in rows[1:] if r[place]] == list(range(len(stamps[name])))
    both = [(float(r[1]), float(r[2])) for r in rows[1:] if r[1] and r[2]]
    assert all(abs(a - b) <= tolerance + 2e-6 for a, b in both)


def test_the_help_has_an_example_that_parses() -> None:
    import sys

    printed = subprocess.run(
        [sys.executable, "-m", "groundstation", "import", "--help"], capture_output=True, text=True, check=True
    )
    assert "groundstation import left.mp4 right.mp4 --rig rig.toml" in printed.stdout
    assert all(len(line) <= 100 for line in printed.stdout.splitlines())


@pytest.mark.parametrize(
    ("more", "without", "told"),
    [
        (
            ("--base", "35.68,139.76,60"),
            (),
            "flight.nmea: base in [dgps], or --base, is not used: it is for a log of base",
        ),
        (("--height", "sea level"), (), "flight.nmea: height in [dgps], or --height, is not used"),
        (("--instance", "1"), (), "flight.nmea: instance in [dgps], or --instance, is not used"),
        (
            ("--height", "sea level"),
            ("--dgps",),
            "--dgps, which is not given: height in [dgps], or --height, is not used",
        ),
        ((), ("--dgps", "--azimuth"), "--origin is not used: the session's place on Earth takes --azimuth as well"),
        (("--date", "2025-05-08"), (), ""),
    ],
)
def test_an_option_without_an_effect_is_told(
    parts: Path,
    capsys: pytest.CaptureFixture[str],
    more: tuple[str, ...],
    without: tuple[str, ...],
    told: str,
) -> None:
    assert run(parts, *more, without=without) == 0
    shown = capsys.readouterr().err
    assert told in shown
    assert ("is not used" in shown) is bool(told)


def test_what_a_table_in_the_sessions_frame_has_no_use_for_is_told(
    parts: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: by the import, and by what loads the session with these keys in [dgps]."""
    (parts / "local.csv").write_text("t_s,x_m,y_m,z_m\n0.5,1,200,20\n0.9,1,199,20\n")
    assert run(parts, "--dgps", str(parts / "local.csv"), "--height", "sea level") == 0
    assert "local.csv: height in [dgps], or --height, is not used" in capsys.readouterr().err
    description = parts / "session" / "session.toml"
    text = description.read_text()
    assert text.count("[dgps]\n") == 1
    description.write_text(text.replace("[dgps]\n", '[dgps]\nheight = "sea level"\n'))
    notes: list[str] = []
    load_dgps(load_session(parts / "session"), on_note=notes.append)
    assert [note.partition(" is not used")[0] for note in notes] == ["dgps.csv: height in [dgps], or --height,"]


def test_angles_whose_times_are_in_milliseconds_are_named(parts: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: the spacing of the rows states the unit, and no quarter of an hour is offered for a time zone's."""
    header, *rows = (parts / "angles.csv").read_text().split()
    times, cells = zip(*(row.split(",", 1) for row in rows), strict=True)
    later = [f"{1000.0 * float(t) + 902.0:.0f},{rest}" for t, rest in zip(times, cells, strict=True)]
    (parts / "angles.csv").write_text("\n".join([header, *later]) + "\n")
    assert run(parts) == 1
    printed = capsys.readouterr().err
    assert (
        "s, 50 s apart and more, 0.05 s if its times are in milliseconds; wanted some while the cameras ran" in printed
    )
    assert "local time" not in printed
