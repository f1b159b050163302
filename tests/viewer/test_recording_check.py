"""A Rerun recording is read to its end before it is shown, in a process that may end on it."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import rerun as rr

from groundstation.errors import InputError
from groundstation.viewer.recording_check import check_recording
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


def test_a_whole_one_passes_and_what_is_none_is_named(recording: Path, tmp_path: Path) -> None:
    check_recording(recording)
    other = tmp_path / "other.rrd"
    other.write_text("no recording")
    assert f"{other}: got " in complaint(InputError, lambda: check_recording(other))
    assert "wanted a Rerun recording (.rrd)" in complaint(InputError, lambda: check_recording(tmp_path / "none.rrd"))


def test_a_reader_that_ends_its_process_is_one_line(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: where the reader aborts on a file, as Rerun's did on one of the fuzz, an error and no backtrace."""

    def aborted(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, -6, stdout="", stderr="thread panicked\nstack backtrace:")

    monkeypatch.setattr(subprocess, "run", aborted)
    said = complaint(InputError, lambda: check_recording(recording))
    assert (
        said == f"{recording}: got a damaged recording, on which Rerun's reader ends; wanted a Rerun recording (.rrd)"
    )


def test_a_reader_that_asks_for_too_much_memory_gets_none() -> None:
    """Expected: a reader that believes a false length gets no memory for it."""
    wanted = "import groundstation.viewer.recording_check as c, sys\nc.limit_memory(0)\nbytes(int(sys.argv[1]) << 20)"
    codes = [
        subprocess.run([sys.executable, "-c", wanted, str(megabytes)], capture_output=True, check=False).returncode
        for megabytes in (64, 400)
    ]
    assert codes == [0, 1]
