"""frames.csv with each station's own frame numbers: cameras that did not start together, or lost frames."""

from pathlib import Path

from tests.session.folder import Tiny, edit_line, number_of, write_video
from tests.sources.events import Played, play

HEAD = "index,left_t_s,right_t_s,left_index,right_index\n"
ROWS = "0,1.0,,0,\n1,1.1,1.11,1,0\n2,1.2,1.21,2,1\n3,,1.31,,2\n4,1.4,1.41,4,3\n"


def recorded(folder: Path) -> Path:
    Tiny(rows=5).write(folder)
    (folder / "frames.csv").write_text(HEAD + ROWS)
    write_video(folder / "right.avi", range(4))
    return folder


def numbers(played: Played, station: str) -> list[int]:
    return [number_of(f.image.whole()) for f in played.delivered_frames(station)]


def test_each_video_counts_for_itself(tmp_path: Path) -> None:
    played = play(recorded(tmp_path))
    assert not played.fault
    assert (numbers(played, "left"), numbers(played, "right")) == ([0, 1, 2, 4], [0, 1, 2, 3])
    assert [e.stations for e in played.epochs][::3] == [("left",), ("right",)]
    assert numbers(play(tmp_path, 1.15, 1.35), "right") == [1, 2]


def test_a_number_that_does_not_grow_or_a_video_that_is_longer(tmp_path: Path) -> None:
    edit_line(recorded(tmp_path) / "frames.csv", 5, "3,,1.31,,1")
    assert "frames.csv: line 5: got right_index = '1'; wanted a whole number above 1" in play(tmp_path).fault
    edit_line(tmp_path / "frames.csv", 5, "3,,1.31,,")
    assert "line 5: got an empty right_index; wanted a finite number" in play(tmp_path).fault
    edit_line(tmp_path / "frames.csv", 5, "3,,1.31,,2")
    write_video(tmp_path / "right.avi", range(6))
    assert "right.avi: got 6 frames; wanted 4 frames as listed in frames.csv" in play(tmp_path).fault
