"""Files that are whole under their name, and tables that end with a whole line, whatever stops the writing."""

import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.files.line_file import LineFile
from groundstation.files.video_check import require_whole_video
from groundstation.files.whole_file import whole_file, whole_folder, write_whole
from tests.files.limits import files_of_at_most


def names(folder: Path) -> list[str]:
    """Return what is in a folder."""
    return sorted(path.name for path in folder.iterdir())


@contextmanager
def interrupted() -> Iterator[None]:
    """Expect that what is done in this context is interrupted."""
    with pytest.raises(KeyboardInterrupt):
        yield


@pytest.mark.parametrize("content", ["a pose: 3 °\r\n", b"\x00\xff"])
def test_a_file_replaces_the_one_before(tmp_path: Path, content: str | bytes) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("before")
    write_whole(path, content)
    assert path.read_bytes() == (content if isinstance(content, bytes) else content.encode())
    assert names(tmp_path) == ["rig.toml"]


def test_an_interrupt_leaves_the_file_before(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    path.write_text("before")
    with interrupted(), whole_file(path) as draft, draft.open("w") as file:
        file.write("half")
        raise KeyboardInterrupt
    assert path.read_text() == "before"
    assert names(tmp_path) == ["page.html"]


def test_a_full_disk_leaves_no_half_file(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="File too large") as told, files_of_at_most(100):
        write_whole(tmp_path / "summary.json", "x" * 200)
    assert told.value.filename == str(tmp_path / "summary.json")
    assert not names(tmp_path)


def test_a_device_is_written_to_and_not_replaced() -> None:
    write_whole(Path(os.devnull), "nothing")
    assert not Path(os.devnull).is_file()


@pytest.mark.parametrize("empty", [False, True])
def test_a_folder_is_there_once_it_is_whole(tmp_path: Path, *, empty: bool) -> None:
    path = tmp_path / "flight"
    if empty:
        path.mkdir()
    with interrupted(), whole_folder(path) as draft:
        (draft / "rig.toml").write_text("half")
        raise KeyboardInterrupt
    assert names(tmp_path) == (["flight"] if empty else [])
    with whole_folder(path) as draft:
        (draft / "rig.toml").write_text("whole")
    assert names(tmp_path) == ["flight"]
    assert (path / "rig.toml").read_text() == "whole"


_LINES = st.lists(st.text(st.characters(exclude_characters="\n", codec="utf-8"), max_size=12), min_size=1, max_size=8)


@given(rows=_LINES, limit=st.integers(min_value=0, max_value=120))
def test_a_table_on_a_full_disk_ends_with_a_whole_line_and_can_go_on(rows: list[str], limit: int) -> None:
    lines = [f"{row}\n" for row in rows]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "track.csv"
        with LineFile(path) as table:
            with files_of_at_most(limit):
                for line in lines:
                    table.write(line)
                    try:
                        table.flush()
                    except OSError as fault:
                        assert fault.filename == str(path)  # noqa: PT017 - not each flush fails
            kept = path.read_bytes()
            assert kept in [b"".join(line.encode() for line in lines[:n]) for n in range(len(lines) + 1)]
            assert len(kept) <= limit
        assert path.read_bytes() == "".join(lines).encode()


def test_an_interrupted_flush_writes_nothing_twice(tmp_path: Path) -> None:
    """The interrupt falls right after the system has taken the lines: they are not lost, and not written again."""
    path = tmp_path / "track.csv"

    def after_the_write(_: object, event: str, called: object) -> None:
        if event == "c_return" and getattr(called, "__name__", "") == "write":
            sys.setprofile(None)
            raise KeyboardInterrupt

    table = LineFile(path)
    table.write("a,1\n")
    sys.setprofile(after_the_write)
    with pytest.raises(KeyboardInterrupt):
        table.flush()
    assert path.read_text() == "a,1\n"
    table.write("b,2\n")
    table.close()
    table.close()
    assert path.read_text() == "a,1\nb,2\n"


def test_a_video_that_the_disk_did_not_take_is_noticed(tmp_path: Path) -> None:
    path, rng = tmp_path / "seen.mp4", np.random.default_rng(3)
    for limit, whole in ((1 << 30, True), (60_000, False)):
        with files_of_at_most(limit):
            video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (160, 120))
            for _ in range(20):
                video.write(rng.integers(0, 255, (120, 160, 3), dtype=np.uint8))
            video.release()
        if whole:
            require_whole_video(path, 20)
        else:
            with pytest.raises(OSError, match="not all of 20 frames"):
                require_whole_video(path, 20)


def test_a_table_of_which_the_disk_took_nothing_is_removed(tmp_path: Path) -> None:
    """Expected: no empty file under its name, whether an older one stood there; one line that was taken stays."""
    old, new = tmp_path / "old.csv", tmp_path / "new.csv"
    old.write_text("a,b\n1,2\n", encoding="utf-8")
    for path in (old, new):
        table = LineFile(path)
        table.write("a,b\n")
        with files_of_at_most(0):
            for end in (table.flush, table.close):
                with pytest.raises(OSError, match=re.escape(str(path))):
                    end()
    assert names(tmp_path) == []
    table = LineFile(new)
    table.write("a,b\n")
    table.flush()
    table.write("1,2\n")
    with files_of_at_most(5), pytest.raises(OSError, match=re.escape(str(new))):
        table.close()
    assert new.read_text(encoding="utf-8") == "a,b\n"


def test_a_fault_in_a_draft_folder_has_the_final_name(tmp_path: Path) -> None:
    path = tmp_path / "flight"
    with pytest.raises(FileNotFoundError) as fault, whole_folder(path) as draft:
        (draft / "none" / "rig.toml").write_text("never", encoding="utf-8")
    assert fault.value.filename == str(path / "none" / "rig.toml")
    with pytest.raises(FileNotFoundError) as fault, whole_folder(path):
        (tmp_path / "elsewhere" / "rig.toml").write_text("never", encoding="utf-8")
    assert fault.value.filename == str(tmp_path / "elsewhere" / "rig.toml")
    assert names(tmp_path) == []
