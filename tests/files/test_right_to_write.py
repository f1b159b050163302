"""A place that cannot be written is reported before a command starts, not after its work."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.files.right_to_write import require_right_to_write

WANTED = "a folder that can be written"


def closed(folder: Path) -> Callable[..., bool]:
    """`os.access` of a user who may not write in a folder; the tests may run as root, who may."""
    before = os.access

    def access(path: os.PathLike[str], mode: int) -> bool:
        return Path(path) not in (folder, folder / "old.csv") and before(path, mode)

    return access


@pytest.mark.parametrize("name", [".", "new", "new/deeper", "old.csv"])
def test_a_closed_folder(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "old.csv").write_text("")
    require_right_to_write(tmp_path / name, WANTED)
    monkeypatch.setattr(os, "access", closed(tmp_path))
    with pytest.raises(InputError, match=rf"got {os.strerror(errno.EACCES)}.*; wanted {WANTED}"):
        require_right_to_write(tmp_path / name, WANTED)


def test_what_can_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: no complaint of a device, of a relative path, or of a file that is replaced in an open folder."""
    (tmp_path / "old.csv").write_text("")
    monkeypatch.chdir(tmp_path)
    before = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "old.csv" and before(path, mode))
    for path in (Path("/dev/null"), Path("new"), Path("new/deeper"), Path("old.csv")):
        require_right_to_write(path, WANTED)


def test_what_is_of_the_wrong_kind_is_left_to_the_command(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    require_right_to_write(tmp_path / "file" / "out", WANTED)


@pytest.mark.parametrize(
    "words",
    [
        ["plan", "docs/site-example.toml", "--out", "OUT"],
        ["view", "recordings/landing-1", "--save", "OUT/landing.rrd"],
        ["bank", "bank.toml", "--out", "OUT"],
        ["replay", "recordings/landing-1", "--out", "elsewhere", "--record", "OUT/landing.mcap"],
    ],
)
def test_before_any_work(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: one line and exit code 1, before the inputs are opened."""
    monkeypatch.setattr(os, "access", closed(tmp_path))
    arguments = [word.replace("OUT", str(tmp_path)) for word in words]
    assert main(arguments) == 1
    said = capsys.readouterr().err
    assert f"got {os.strerror(errno.EACCES)} in {tmp_path}; wanted a " in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())
