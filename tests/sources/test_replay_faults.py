"""A fault stops with one line; what was usable before it has been yielded."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.mutation import damaged
from tests.session.folder import SIZE, Tiny, edit_line, picture, replace_in, write_pictures, write_video
from tests.sources.events import Played, play


def stopped(folder: Path, message: str) -> Played:
    played = play(folder)
    assert message in played.fault
    played.check_order()
    played.check_pictures()
    return played


# ------------------------------------------------------------------------------------------------ tables
@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("6,1.3,1.6", "got left_t_s = 1.3, an earlier time than the row before; wanted later than 1.5"),
        ("6,1.6,1.5", "got right_t_s = 1.5, the same time as the row before; wanted later than 1.5"),
        ("6,nan,1.6", "got left_t_s = 'nan'; wanted a finite number"),
        ("6,1.6,soon", "got right_t_s = 'soon'; wanted a finite number"),
        ("5,1.6,1.6", "got index = '5'; wanted a whole number above 5"),
        ("6.5,1.6,1.6", "got index = '6.5'; wanted a whole number above 5"),
        ("-1,1.6,1.6", "got index = '-1'; wanted a whole number above 5"),
        ("1e12,1.6,1.6", "got index = '1e12'; wanted at most 50000000"),
        (",1.6,1.6", "got an empty index; wanted a finite number"),
        ("6,1.6", "got 2 cells; wanted 3 as in the header"),
    ],
)
def test_a_bad_row_of_frames_ends_the_flight_there(tmp_path: Path, row: str, message: str) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    edit_line(folder / "frames.csv", 8, row)
    played = stopped(folder, f"frames.csv: line 8: {message}")
    assert [e.epoch for e in played.epochs] == list(range(6))
    assert len(played.frames) == 12
    assert played.readings[-1].t_s >= 1.5


def test_a_time_may_not_go_back_over_a_missing_frame(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    edit_line(folder / "frames.csv", 7, "5,1.5,")
    edit_line(folder / "frames.csv", 8, "6,1.6,1.39")
    assert [e.epoch for e in stopped(folder, "line 8: got right_t_s = 1.39, an earlier time").epochs][-1] == 5


def test_a_fault_after_the_requested_part_has_no_effect(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    edit_line(folder / "frames.csv", 12, "nonsense,,")
    edit_line(folder / "ptu.csv", 38, "nonsense,,,,")
    assert not play(folder, to_s=1.25).fault


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1.15,0,0,0,0", "got t_s = 1.15, an earlier time than the row before; wanted later than 1.45"),
        ("1.45,0,0,0,0", "got t_s = 1.45, the same time as the row before; wanted later than 1.45"),
        ("inf,0,0,0,0", "got t_s = 'inf'; wanted a finite number"),
        ("1.5,0,0,0,left", "got right_tilt_deg = 'left'; wanted a finite number"),
        ("1.5,0,,0,0", "got only one of left's two angles; wanted pan and tilt, or neither"),
        ("1.5,0,0,0", "got 4 cells; wanted 5 as in the header"),
    ],
)
def test_a_bad_row_of_angles_ends_the_flight_there(tmp_path: Path, row: str, message: str) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    edit_line(folder / "ptu.csv", 18, row)
    played = stopped(folder, f"ptu.csv: line 18: {message}")
    assert [e.epoch for e in played.epochs] == list(range(5))
    assert played.readings[-1].t_s == pytest.approx(1.45)


@pytest.mark.parametrize("far_s", [9999.0, 2.2])
@pytest.mark.parametrize("to_s", [None, 1.62])
def test_a_reading_far_ahead_ends_the_flight_at_the_next_row(tmp_path: Path, far_s: float, to_s: float | None) -> None:
    """Expected: the fault names the row that is earlier, and the row ahead of it is not used, in or after the span."""
    folder = Tiny(rows=12).write(tmp_path)
    edit_line(folder / "ptu.csv", 17, f"{far_s:g},0,0,0,0")
    played = play(folder, to_s=to_s)
    assert played.fault == (
        f"ptu.csv: line 18: got t_s = 1.5, an earlier time than the row before; wanted later than {far_s:g}"
    )
    assert [e.epoch for e in played.epochs] == list(range(5))
    assert played.readings[-1].t_s == pytest.approx(1.4)


def test_a_reading_far_ahead_after_the_requested_part_has_no_effect(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    edit_line(folder / "ptu.csv", 37, "9999,0,0,0,0")
    assert not play(folder, to_s=1.25).fault


def test_a_gap_in_the_readings_is_no_fault(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    rows = (folder / "ptu.csv").read_text().splitlines()
    (folder / "ptu.csv").write_text("\n".join([*rows[:14], *rows[24:]]) + "\n")
    played = play(folder)
    assert not played.fault
    assert len(played.epochs) == 12


@pytest.mark.parametrize("line", [2, 8])
def test_a_stamp_far_ahead_ends_the_flight_before_it(tmp_path: Path, line: int) -> None:
    """Expected: also of a part that ends before the stamp, which would make the fault one of a later part."""
    folder = Tiny(rows=12).write(tmp_path)
    row = line - 2
    edit_line(folder / "frames.csv", line, f"{row},{1.0 + 0.1 * row},9999")
    for to_s in (None, 1.9):
        played = play(folder, to_s=to_s)
        assert played.fault == (
            f"frames.csv: line {line + 1}: got right_t_s = {1.1 + 0.1 * row:g}, an earlier time than the row before; "
            "wanted later than 9999"
        )
        assert [e.epoch for e in played.epochs] == list(range(row))


def test_angles_that_have_no_time_in_common_with_the_frames(tmp_path: Path) -> None:
    folder = Tiny(rows=12, ptu_from_s=-9.0, ptu_to_s=-8.0).write(tmp_path)
    played = play(folder)
    assert not played.events
    assert played.fault.startswith(
        "ptu.csv: got readings from -9 to -8 s; wanted readings around the frames, 0 to 3.1 s"
    )
    (folder / "ptu.csv").write_text((folder / "ptu.csv").read_text().splitlines()[0])
    assert play(folder).fault.startswith("ptu.csv: got no reading; wanted readings around the frames")


@pytest.mark.parametrize("name", ["frames.csv", "ptu.csv"])
@pytest.mark.parametrize("content", ["", "index,t_s,left_t_s,left_pan_deg,left_tilt_deg\n1,1,1,0,0\n"])
def test_a_table_that_is_empty_or_lacks_a_station(tmp_path: Path, name: str, content: str) -> None:
    folder = Tiny(rows=3).write(tmp_path)
    (folder / name).write_text(content)
    missing = {"frames.csv": ("index", "right_t_s"), "ptu.csv": ("t_s", "right_pan_deg")}[name][bool(content)]
    played = stopped(folder, f"{name}: line 1: got ")
    assert played.fault.endswith(f"wanted a column {missing}")
    assert not played.events


def test_a_missing_table(tmp_path: Path) -> None:
    folder = Tiny(rows=3).write(tmp_path)
    (folder / "ptu.csv").unlink()
    stopped(folder, "ptu.csv: got no such file; wanted a table with t_s, left_pan_deg")
    (folder / "frames.csv").unlink()
    stopped(folder, "got pictures without frames.csv")


def test_a_table_of_frames_without_a_row(tmp_path: Path) -> None:
    folder = Tiny(rows=3).write(tmp_path)
    (folder / "frames.csv").write_text("index,left_t_s,right_t_s\n0,,\n")
    assert stopped(folder, "tiny: frames.csv: got no row with a time; wanted at least one").events == []
    (folder / "frames.csv").write_text("index,left_t_s,right_t_s\n0,x,1\n")
    assert stopped(folder, "frames.csv: line 2: got left_t_s = 'x'").events == []


# ----------------------------------------------------------------------------------------------- pictures
def test_a_video_with_fewer_frames_than_rows(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    write_video(folder / "right.avi", range(9))
    message = "right.avi: frame 9: got the end of the video after 9 frames; wanted 12 frames as listed in frames.csv"
    played = stopped(folder, message)
    assert [e.epoch for e in played.epochs] == list(range(9))
    assert len(played.delivered_frames("left")) == 10


def test_a_video_with_more_frames_than_rows(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    write_video(folder / "left.avi", range(15))
    played = stopped(folder, "left.avi: got 15 frames; wanted 12 frames as listed in frames.csv")
    assert len(played.epochs) == 12


def test_more_pictures_than_rows(tmp_path: Path) -> None:
    folder = Tiny(rows=3, video="png").write(tmp_path)
    cv2.imwrite(str(folder / "left" / "000007.png"), picture(7))
    message = "left: got a picture 000007.png; wanted 3 pictures as listed in frames.csv"
    assert len(stopped(folder, message).epochs) == 3


@pytest.mark.parametrize("video", ["avi", "png"])
def test_pictures_of_another_size_than_the_rigs(tmp_path: Path, video: str) -> None:
    folder = Tiny(rows=3, video=video).write(tmp_path)
    text = (folder / "rig.toml").read_text()
    head, tail = text.rsplit("[64, 48]", 1)
    (folder / "rig.toml").write_text(f"{head}[640, 480]{tail}")
    played = stopped(folder, ": got 64×48 px; wanted 640×480 px as in the rig")
    assert played.fault.startswith("right")
    assert not played.epochs


def test_one_picture_of_another_size(tmp_path: Path) -> None:
    folder = Tiny(rows=6, video="png").write(tmp_path)
    small = np.zeros((SIZE[1] - 1, SIZE[0], 3), dtype=np.uint8)
    cv2.imwrite(str(folder / "left" / "000004.png"), small)
    played = stopped(folder, "left: frame 4: got 64×47 px; wanted 64×48 px as in the rig")
    assert len(played.epochs) == 4


def test_a_missing_picture_and_one_that_cannot_be_decoded(tmp_path: Path) -> None:
    folder = Tiny(rows=6, video="png").write(tmp_path)
    (folder / "right" / "000005.png").unlink()
    played = stopped(folder, "right: got no picture number 5; wanted 000005.png for frames.csv line 7")
    assert len(played.epochs) == 5
    for content in (b"", b"no picture", (folder / "right" / "000003.png").read_bytes()[:40]):
        (folder / "right" / "000003.png").write_bytes(content)
        played = stopped(
            folder, "right: frame 3: got bytes that cannot be decoded; wanted a picture for frames.csv line 5"
        )
        assert len(played.epochs) == 3


def test_a_jpeg_cut_short_is_no_picture(tmp_path: Path) -> None:
    """OpenCV would decode its first rows and leave the rest grey."""
    folder = Tiny(rows=6, video="none").write(tmp_path)
    for name in ("left", "right"):
        (folder / name).mkdir()
        for number in range(6):
            assert cv2.imwrite(str(folder / name / f"{number:06d}.jpg"), picture(number))
    assert len(play(folder).epochs) == 6
    path = folder / "left" / "000004.jpg"
    path.write_bytes(path.read_bytes()[:-200])
    played = stopped(folder, "left: frame 4: got bytes that cannot be decoded")
    assert len(played.epochs) == 4


def test_an_empty_folder_of_pictures(tmp_path: Path) -> None:
    folder = Tiny(rows=2, video="none").write(tmp_path)
    for name in ("left", "right"):
        write_pictures(folder / name, [])
    assert not stopped(folder, "left/: got no picture; wanted 000000.png").epochs


def test_two_pictures_with_one_number(tmp_path: Path) -> None:
    folder = Tiny(rows=2, video="png").write(tmp_path)
    cv2.imwrite(str(folder / "left" / "1.png"), picture(1))
    stopped(folder, "left: got 000001.png and 1.png; wanted one picture with the number 1")


def test_a_truncated_video(tmp_path: Path) -> None:
    folder = Tiny(rows=60, ptu_to_s=9.0).write(tmp_path)
    content = (folder / "left.avi").read_bytes()
    # the cut falls between two frames: the container's index at the end is lost, the frames before are not
    cut = content.rfind(b"00dc", 0, len(content) // 2)
    (folder / "left.avi").write_bytes(content[:cut])
    played = stopped(folder, ": got the end of the video after ")
    assert "of the 60 that its header announces" in played.fault
    assert 15 < len(played.epochs) < 45


@pytest.mark.parametrize("keep", [0, 10, 0.5])
def test_a_file_that_is_no_complete_mp4(tmp_path: Path, keep: float) -> None:
    folder = Tiny(rows=12, video="none").write(tmp_path)
    for name in ("left", "right"):
        write_video(folder / f"{name}.mp4", range(12), "mp4v")
    content = (folder / "left.mp4").read_bytes()
    (folder / "left.mp4").write_bytes(content[: int(keep * len(content)) if keep < 1 else int(keep)])
    played = stopped(folder, "left.mp4: got no video that OpenCV can open; wanted a complete video file")
    assert not played.epochs


def test_the_first_fault_is_reported(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    edit_line(folder / "frames.csv", 12, "broken,,")
    assert "frames.csv: line 12" in stopped(folder, "frames.csv").fault
    edit_line(folder / "ptu.csv", 20, "broken,,,,")
    assert "ptu.csv: line 20" in stopped(folder, "ptu.csv").fault
    write_video(folder / "left.avi", range(3))
    assert len(stopped(folder, "left.avi: frame 3: got the end of the video").epochs) == 3


def test_a_rig_fault_is_reported_before_all(tmp_path: Path) -> None:
    folder = Tiny(rows=3).write(tmp_path)
    replace_in(folder / "rig.toml", "300.0, 300.0", "300.0, -300.0")
    assert "rig.toml: station left: focal_px: got [300.0, -300.0]; wanted two numbers > 0" in play(folder).fault


@settings(max_examples=60)
@given(name=st.sampled_from(["frames.csv", "ptu.csv"]), data=st.data())
def test_whatever_becomes_of_a_table_events_stay_in_order(
    tmp_path_factory: pytest.TempPathFactory, name: str, data: st.DataObject
) -> None:
    folder = tmp_path_factory.getbasetemp() / "damaged"
    if not folder.is_dir():
        Tiny(rows=4, video="png", ptu_to_s=1.6).write(folder)
    intact = (folder / name).read_text()
    try:
        (folder / name).write_bytes(data.draw(damaged(intact)))
        played = play(folder)
    finally:
        (folder / name).write_text(intact)
    played.check_order()
    played.check_pictures()
