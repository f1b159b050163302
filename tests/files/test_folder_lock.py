"""One run at a time writes into a folder: while a process holds it, another is refused, and its end frees it."""

import subprocess
import sys
from pathlib import Path

import pytest

from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.files.folder_lock import locked_folder
from tests.session.folder import Tiny

_HOLD = """
import sys
from pathlib import Path
from groundstation.files.folder_lock import locked_folder
with locked_folder(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_folder_is_held_until_its_process_ends(tmp_path: Path) -> None:
    words = [sys.executable, "-c", _HOLD, str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(InputError, match="into which another run writes"), locked_folder(tmp_path):
            pass
        other.kill()
        other.wait()
    with locked_folder(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_two_replays_do_not_share_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, out = Tiny(rows=12).write(tmp_path / "session"), tmp_path / "out"
    out.mkdir()
    words = ["replay", str(session), "--out", str(out), "--no-rerun"]
    with locked_folder(out):
        assert main(words) == 1
        assert f"{out}: got a folder into which another run writes" in capsys.readouterr().err
        assert list(out.iterdir()) == []
    assert main(words) == 0
