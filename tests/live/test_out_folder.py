"""A start that fails leaves nothing behind; one that has begun keeps everything, whatever follows."""

from pathlib import Path

import pytest

from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.live.out_folder import removed_unless_started, require_free
from groundstation.rig.rig_toml import rig_to_toml
from tests.live.test_operation import small_rig


def operate(out: Path, fault: BaseException, *, begins: bool) -> None:
    with removed_unless_started(out) as folder:
        out.mkdir(exist_ok=True)
        (out / "flight.mcap").write_bytes(b"x")
        (out / "ptu-left").symlink_to("/dev/pts/none")
        if begins:
            folder.keep()
        raise fault


@pytest.mark.parametrize("was_there", [False, True])
def test_what_never_began_leaves_the_folder_as_it_was(tmp_path: Path, *, was_there: bool) -> None:
    out = tmp_path / "out"
    if was_there:
        out.mkdir()
    with pytest.raises(KeyboardInterrupt):
        operate(out, KeyboardInterrupt(), begins=False)
    assert out.exists() is was_there
    require_free(out)


def test_started_output_is_kept(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(OSError, match="later"):
        operate(out, OSError("later"), begins=True)
    assert (out / "flight.mcap").read_bytes() == b"x"
    with pytest.raises(InputError, match="wanted a new or empty folder"):
        require_free(out)


def test_a_file_in_place_of_a_folder_is_reported(tmp_path: Path) -> None:
    (tmp_path / "flights").touch()
    with pytest.raises(InputError, match="flights, a file; wanted a folder"):
        require_free(tmp_path / "flights" / "today" / "one")


def test_the_same_command_can_be_given_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: a missing PTU is reported in one line, twice the same; no folder is in the way."""
    (tmp_path / "rig.toml").write_text(rig_to_toml(small_rig()), encoding="utf-8")
    (tmp_path / "station.toml").write_text(
        f"""format = "groundstation-station/1"
[[station]]
name = "left"
camera = "opencv:90"
ptu = "{tmp_path}/left"
[[station]]
name = "right"
camera = "opencv:91"
ptu = "{tmp_path}/right"
""",
        encoding="utf-8",
    )
    reported = []
    for _ in range(2):
        assert main(["live", str(tmp_path / "station.toml"), "--out", str(tmp_path / "out")]) == 1
        reported.append(capsys.readouterr().err)
        assert not (tmp_path / "out").exists()
    assert "left: PTU:" in reported[0]
    assert reported[0] == reported[1]


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    """Expected: what was got and wanted, where the system gives a number; another file's fault stays what it is."""
    out = tmp_path / "out"
    with pytest.raises(InputError, match=r"out: got No such file or directory; wanted a folder that files can be"):
        operate(out, FileNotFoundError(2, "No such file or directory", str(out)), begins=False)
    with pytest.raises(FileNotFoundError):
        operate(out, FileNotFoundError(2, "No such file or directory", "/elsewhere"), begins=False)
