"""What the operating system refuses, in the words of a user: no number, one line, the file named once."""

import errno
import os
from pathlib import Path

import pytest

from groundstation.cli.main import main
from groundstation.errors import InputError, os_words
from groundstation.sinks.track_files import TrackFilesSink
from ptu_drivers.errors import os_words as line_words

COMMON = (
    errno.ENOSPC,
    errno.EACCES,
    errno.EISDIR,
    errno.ENOENT,
    errno.EMFILE,
    errno.EBUSY,
    errno.ENOTDIR,
    errno.EROFS,
    errno.EIO,
    errno.ECONNREFUSED,
)


@pytest.mark.parametrize("number", COMMON)
@pytest.mark.parametrize("name", ["track.csv", None])
def test_a_command_ends_with_words(
    number: int, name: str | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fault = OSError(number, os.strerror(number)) if name is None else OSError(number, os.strerror(number), name)

    def fail(*_: object) -> None:
        raise fault

    monkeypatch.setattr("groundstation.tracking.config.load_config", fail)
    assert main(["config"]) == 1
    place = "" if name is None else f"{name}: "
    assert capsys.readouterr().err == f"groundstation: {place}{os.strerror(number)}\n"
    assert os_words(fault) == line_words(fault) == os.strerror(number)


def test_words_within_the_text_of_a_library() -> None:
    assert os_words(OSError("[Errno 5] could not be read")) == "could not be read"
    assert os_words(OSError(errno.ENOSPC, "")) == os.strerror(errno.ENOSPC)
    assert os_words(ValueError("first\nsecond")) == "first"
    assert os_words(OSError()) == "OSError"
    # pyserial's, which repeat path and number
    text = "could not open port /dev/x: [Errno 2] No such file or directory: '/dev/x'"
    assert line_words(OSError(text)) == "No such file or directory"
    assert line_words(OSError("Could not configure port: (5, 'Input/output error')")) == "Input/output error"
    no_line = OSError("Could not configure port: (25, 'Inappropriate ioctl for device')")
    assert line_words(no_line) == "a device that is no serial line"
    said = str(InputError("a.csv", got="[Errno 13] Permission denied", wanted="a file"))
    assert said == "a.csv: got Permission denied; wanted a file"


def test_a_folder_below_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match=r"file/out: got Not a directory; wanted a folder that can be written$"):
        TrackFilesSink(tmp_path / "file" / "out")
