from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import SessionError
from groundstation.messages import Epoch, Frame, PtuSample
from groundstation.session import load_session
from groundstation.sources.folder_source import FolderSource
from tests.complaints import complaint
from tests.session.folder import SESSION, Tiny, write_video
from tests.sources.events import play


def test_a_plain_session(tmp_path: Path) -> None:
    played = play(Tiny(rows=12).write(tmp_path))
    assert not played.fault
    played.check_order()
    played.check_pictures()
    assert [e.epoch for e in played.epochs] == list(range(12))
    assert [f.station for f in played.frames] == ["left", "right"] * 12
    assert all(e.stations == ("left", "right") for e in played.epochs)
    # at equal times a reading goes before the frames that it serves
    kinds = [type(e) for e in played.events if abs(e.t_s - 1.2) < 1e-9]
    assert kinds == [PtuSample, PtuSample, Frame, Frame, Epoch]


def test_what_is_known_on_entry(tmp_path: Path) -> None:
    with FolderSource(load_session(Tiny(rows=12).write(tmp_path))) as source:
        assert source.epoch_count == 12
        assert source.span_s == pytest.approx((1.0, 2.1))


def test_readings_in_radians_until_a_second_after_the_last_frame(tmp_path: Path) -> None:
    played = play(Tiny(rows=3, ptu_from_s=-5.0, ptu_to_s=9.0).write(tmp_path))
    times = [r.t_s for r in played.readings if r.station == "left"]
    assert (times[0], times[-1]) == pytest.approx((0.0, 2.2))
    first = played.readings[0]
    assert (first.pan_rad, first.tilt_rad) == pytest.approx((np.radians(1.0), np.radians(1.1)))


def test_missing_frames_keep_their_number(tmp_path: Path) -> None:
    left = [1.0, None, None, 1.3, None, 1.5]
    right = [None, 1.1, None, 1.3, 1.4, 1.5]
    played = play(Tiny(rows=6, stamps={"left": left, "right": right}).write(tmp_path))
    assert not played.fault
    played.check_order()
    played.check_pictures()
    assert [f.epoch for f in played.delivered_frames("left")] == [0, 3, 5]
    assert [f.epoch for f in played.delivered_frames("right")] == [1, 3, 4, 5]
    # row 2 has no stamp at all: no time to answer at
    assert [(e.epoch, e.stations) for e in played.epochs] == [
        (0, ("left",)),
        (1, ("right",)),
        (3, ("left", "right")),
        (4, ("right",)),
        (5, ("left", "right")),
    ]


@pytest.mark.parametrize("video", ["avi", "png"])
def test_indices_that_skip(tmp_path: Path, video: str) -> None:
    played = play(Tiny(rows=4, index=(2, 3, 7, 11), video=video).write(tmp_path))
    assert not played.fault
    played.check_pictures()
    assert [e.epoch for e in played.epochs] == [2, 3, 7, 11]


@pytest.mark.parametrize("late_s", [0.03, 0.25, 1.5])
def test_cameras_that_do_not_expose_together(tmp_path: Path, late_s: float) -> None:
    right = [1.0 + 0.1 * k + late_s for k in range(25)]
    played = play(Tiny(rows=25, stamps={"right": list(right)}, ptu_to_s=6.0).write(tmp_path))
    assert not played.fault
    played.check_order()
    played.check_pictures()
    assert len(played.frames) == 50
    assert [e.t_s for e in played.epochs] == pytest.approx([1.0 + 0.1 * k + late_s / 2 for k in range(25)])


def test_a_video_may_continue_after_a_last_frame_without_a_stamp(tmp_path: Path) -> None:
    stamps = {n: [1.0, 1.1, None] for n in ("left", "right")}
    played = play(Tiny(rows=3, stamps=stamps).write(tmp_path))
    assert not played.fault
    assert len(played.frames) == 4


def test_three_stations_one_of_them_fixed(tmp_path: Path) -> None:
    played = play(Tiny(rows=5, names=("left", "right", "third"), fixed=("third",)).write(tmp_path))
    assert not played.fault
    played.check_order()
    played.check_pictures()
    assert {r.station for r in played.readings} == {"left", "right"}
    assert played.epochs[0].stations == ("left", "right", "third")


def test_fixed_stations_need_no_ptu_table(tmp_path: Path) -> None:
    folder = Tiny(rows=5, fixed=("left", "right")).write(tmp_path)
    assert not (folder / "ptu.csv").exists()
    played = play(folder)
    assert not played.fault
    assert not played.readings
    assert len(played.frames) == 10


def test_a_station_without_any_frame(tmp_path: Path) -> None:
    played = play(Tiny(rows=5, stamps={"right": [None] * 5}).write(tmp_path))
    assert not played.fault
    assert len(played.delivered_frames("left")) == len(played.epochs) == 5


# ----------------------------------------------------------------------------------------------- clocks
def test_each_camera_has_its_own_clock(tmp_path: Path) -> None:
    text = SESSION + "[clocks]\nleft = { offset_s = 10.0 }\nright = { offset_s = 50.0 }\nptu = { offset_s = 10.0 }\n"
    folder = Tiny(
        rows=3,
        session=text,
        stamps={"right": [11.0, 11.1, 11.2]},
        rig_more={"right": "camera_clock = { offset_s = 0.02, drift_ppm = 100.0 }"},
    ).write(tmp_path)
    played = play(folder)
    played.check_order()
    assert [f.t_s for f in played.delivered_frames("left")] == pytest.approx([11.0, 11.1, 11.2])
    assert [f.t_s for f in played.delivered_frames("right")] == pytest.approx([11.0211, 11.12111, 11.22112])
    assert played.readings[0].t_s == pytest.approx(10.7)


def test_each_ptu_has_its_own_clock(tmp_path: Path) -> None:
    clocks = {
        "left": "ptu_clock = { offset_s = 0.037 }",
        "right": "ptu_clock = { offset_s = -0.4, drift_ppm = 1000.0 }",
    }
    played = play(Tiny(rows=12, rig_more=clocks).write(tmp_path))
    played.check_order()
    left = [r.t_s for r in played.readings if r.station == "left"]
    right = [r.t_s for r in played.readings if r.station == "right"]
    assert left[:2] == pytest.approx([0.737, 0.787])
    assert right[:2] == pytest.approx([0.3007, 0.35075])
    assert len(left) == len(right) == 37


def test_a_table_may_leave_out_one_stations_angles(tmp_path: Path) -> None:
    folder = Tiny(rows=5).write(tmp_path)
    lines = (folder / "ptu.csv").read_text().splitlines()
    for k in range(1, len(lines), 2):
        cells = lines[k].split(",")
        lines[k] = ",".join([*cells[:3], "", ""])
    (folder / "ptu.csv").write_text("\n".join(lines))
    played = play(folder)
    assert not played.fault
    played.check_order()
    by_station = [sum(r.station == n for r in played.readings) for n in ("left", "right")]
    assert by_station[0] == pytest.approx(2 * by_station[1], abs=1)


# ------------------------------------------------------------------------------------------------- parts
def test_a_part_begins_a_second_early_with_the_readings(tmp_path: Path) -> None:
    played = play(Tiny(rows=40, ptu_from_s=0.0, ptu_to_s=6.0).write(tmp_path), 3.0, 3.45)
    assert not played.fault
    played.check_order()
    played.check_pictures()
    assert [e.epoch for e in played.epochs] == [20, 21, 22, 23, 24]
    times = [r.t_s for r in played.readings]
    assert (times[0], times[-1]) == pytest.approx((2.0, 4.4))


def test_a_part_is_selected_by_the_mean_stamp(tmp_path: Path) -> None:
    right = [1.0 + 0.1 * k + 0.06 for k in range(12)]
    played = play(Tiny(rows=12, stamps={"right": list(right)}).write(tmp_path), 1.12, 1.33)
    assert [e.epoch for e in played.epochs] == [1, 2, 3]
    assert [f.epoch for f in played.delivered_frames("left")] == [1, 2, 3]


@pytest.mark.parametrize(
    ("from_s", "to_s", "message"),
    [
        (2.0, 1.0, "tiny: got a part from 2 to 1 s; wanted a start before the end"),
        (1.5, 1.5, "tiny: got a part from 1.5 to 1.5 s; wanted a start before the end"),
        (float("nan"), None, "tiny: got a part from nan s on; wanted a start before the end"),
        (5.0, None, "tiny: frames.csv: got times from 1 to 2.1 s; wanted some from 5 s on"),
        (None, 0.5, "tiny: frames.csv: got times from 1 to 2.1 s; wanted some up to 0.5 s"),
        (1.51, 1.59, "tiny: frames.csv: got times from 1 to 2.1 s; wanted some from 1.51 to 1.59 s"),
    ],
)
def test_a_part_that_is_not_there(tmp_path: Path, from_s: float | None, to_s: float | None, message: str) -> None:
    played = play(Tiny(rows=12).write(tmp_path), from_s, to_s)
    assert played.fault == message
    assert not played.events


def test_a_part_need_not_be_the_whole_video(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    write_video(folder / "left.avi", range(20))
    assert not play(folder, 1.05, 3.0).fault
    assert "left.avi" in play(folder).fault


def test_the_bundled_session(landing_1: Path) -> None:
    played = play(landing_1, 1.05, 2.05)
    assert not played.fault
    played.check_order()
    assert len(played.epochs) == 10
    assert played.frames[0].image.whole().shape == (960, 1280, 3)
    assert played.frames[0].image.whole().dtype == np.uint8


def test_entering_without_anything_to_replay_leaves_no_thread(tmp_path: Path) -> None:
    folder = Tiny(rows=3, ptu_from_s=100.0, ptu_to_s=101.0).write(tmp_path)
    source = FolderSource(load_session(folder))
    reported = complaint(SessionError, source.__enter__)
    assert (
        reported
        == "ptu.csv: got a first reading at 100 s; wanted readings around the frames, 0 to 2.2 s of the session's clock"
    )


def test_pictures_in_milliseconds_are_called_so(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    table = folder / "frames.csv"
    head, *rows = table.read_text().splitlines()
    stored = [",".join([n, *(f"{1000.0 * float(t):.3f}" for t in times)]) for n, *times in (r.split(",") for r in rows)]
    table.write_text("\n".join([head, *stored]) + "\n")
    reported = complaint(SessionError, FolderSource(load_session(folder), None, 2.0).__enter__)
    assert "frames.csv: got times from 1000 to 2100 s, which would be 1 s if its times were in milliseconds" in reported


def test_readings_in_milliseconds_are_called_so(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    table = folder / "ptu.csv"
    head, *rows = table.read_text().splitlines()
    cells = [row.split(",") for row in rows]
    stored = [",".join([f"{1000.0 * float(first) + 300.0:.3f}", *others]) for first, *others in cells]
    table.write_text("\n".join([head, *stored]) + "\n")
    reported = complaint(SessionError, FolderSource(load_session(folder)).__enter__)
    assert "got a first reading at" in reported
    assert "s if its times were in milliseconds; wanted readings around the frames" in reported


def test_readings_in_milliseconds_of_a_part(tmp_path: Path) -> None:
    """Expected: named also where the table begins long before the part that is replayed."""
    folder = Tiny(rows=120, ptu_to_s=14.0).write(tmp_path)
    table = folder / "ptu.csv"
    head, *rows = table.read_text().splitlines()
    stored = [",".join([f"{1000.0 * float(t):.3f}", *others]) for t, *others in (row.split(",") for row in rows)]
    table.write_text("\n".join([head, *stored]) + "\n")
    reported = complaint(SessionError, FolderSource(load_session(folder), 8.0).__enter__)
    assert "got a first reading at 700 s, which would be 0.7 s if its times were in milliseconds" in reported


def test_pictures_in_milliseconds_among_readings(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    table = folder / "frames.csv"
    head, *rows = table.read_text().splitlines()
    stored = [",".join([n, *(f"{1000.0 * float(t):.3f}" for t in times)]) for n, *times in (r.split(",") for r in rows)]
    table.write_text("\n".join([head, *stored]) + "\n")
    reported = complaint(SessionError, FolderSource(load_session(folder)).__enter__)
    assert "among which the pictures would be if their times were in milliseconds; wanted readings around" in reported


def test_a_table_of_frames_that_is_no_file(tmp_path: Path) -> None:
    folder = Tiny(rows=2).write(tmp_path)
    (folder / "frames.csv").unlink()
    (folder / "frames.csv").symlink_to(folder / "nothing")
    assert complaint(SessionError, lambda: load_session(folder)).endswith(
        "frames.csv: got a link to what is not there; wanted a table"
    )
