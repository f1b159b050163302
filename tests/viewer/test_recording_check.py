"""A Rerun recording is read to its end before it is shown, in a process that may end on it."""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import rerun as rr

from groundstation.errors import InputError
from groundstation.viewer.merge_recordings import chunks
from groundstation.viewer.recording_check import check_recording, read_to_end
from tests.complaints import complaint


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "run.rrd"
    stream = rr.RecordingStream("test", send_properties=False)
    stream.save(path)
    for k in range(20):
        stream.set_time("frame", sequence=k)
        stream.log("point", rr.Points3D([[0.0, 0.0, float(k)]]))
    stream.flush()
    stream.disconnect()
    return path


def test_a_whole_one_passes_and_another_file_is_named(recording: Path, tmp_path: Path) -> None:
    check_recording(recording)
    other = tmp_path / "other.rrd"
    other.write_text("no recording")
    assert f"{other}: got " in complaint(InputError, lambda: check_recording(other))
    assert "wanted a Rerun recording (.rrd)" in complaint(InputError, lambda: check_recording(tmp_path / "none.rrd"))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 0.9, 1.0])
def test_a_cut_file_is_read_as_by_those_who_show_it(recording: Path, tmp_path: Path, share: float) -> None:
    """Expected: of what the viewer's reader refuses the check gives the same line, and nothing else is refused."""
    cut = tmp_path / "cut.rrd"
    content = recording.read_bytes()
    cut.write_bytes(content[: round(share * len(content))])

    def outcome(read: Callable[[], object]) -> str:
        try:
            read()
        except InputError as fault:
            return str(fault)
        return "whole"

    checked = outcome(lambda: read_to_end(cut))
    assert checked == outcome(lambda: list(chunks(cut)))
    assert (checked == "whole") == (share == 1.0)


@pytest.mark.parametrize(
    ("program", "got"),
    [
        ("import os; os.abort()", "a damaged recording, on which Rerun's reader ends"),
        ("import time; kept = b'1' * (600 << 20); time.sleep(60)", r"a recording that takes more than \d+ MB to read"),
        ("import time; time.sleep(60)", r"a recording that is not read in 0\.5 s"),
    ],
)
def test_a_reader_that_aborts_grows_or_hangs_is_one_line(
    recording: Path, monkeypatch: pytest.MonkeyPatch, program: str, got: str
) -> None:
    """Expected: an error without a backtrace; Rerun's reader did each of these on a file of the fuzz."""
    started = subprocess.Popen

    def stand_in(command: list[str], **streams: Any) -> "subprocess.Popen[bytes]":
        return started([command[0], "-c", program], **streams)

    monkeypatch.setattr("groundstation.viewer.recording_check.subprocess.Popen", stand_in)
    if "not read" in got:
        monkeypatch.setattr("groundstation.viewer.recording_check._WITHIN_S", 0.5)
    reported = complaint(InputError, lambda: check_recording(recording))
    assert re.fullmatch(rf"{re.escape(str(recording))}: got {got}; wanted a Rerun recording \(\.rrd\)", reported)
