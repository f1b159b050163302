"""What `groundstation onboard render` leaves where it does not come to its end."""

from pathlib import Path

import pytest

from groundstation.cli.main import main
from tests.files.limits import files_of_at_most


def test_a_full_disk_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: of tables and video neither an empty nor a part, and no folder; one line."""
    out = tmp_path / "nose"
    for limit in (100, 20_000):
        with files_of_at_most(limit):
            assert main(["onboard", "render", "--out", str(out), "--frames", "2"]) == 1
        assert f"{out}: got " in capsys.readouterr().err.splitlines()[-1]
        assert not out.exists()


def test_a_file_in_place_of_the_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "nose").write_text("", encoding="utf-8")
    assert main(["onboard", "render", "--out", str(tmp_path / "nose"), "--frames", "2"]) == 1
    assert capsys.readouterr().err.endswith("nose: got a file; wanted a folder that can be written\n")


def test_an_interrupt_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("groundstation.onboard.render.require_whole_video", interrupted)
    out = tmp_path / "nose"
    out.mkdir()
    (out / "notes.txt").write_text("kept", encoding="utf-8")
    assert main(["onboard", "render", "--out", str(out), "--frames", "2"]) == 130
    assert [path.name for path in out.iterdir()] == ["notes.txt"]


def test_nothing_has_its_name_before_all_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a kill at any time of the rendering, here before its last step, leaves drafts alone."""
    seen: list[str] = []

    def look(*_: object) -> None:
        seen.extend(path.name for path in (tmp_path / "nose").iterdir())

    monkeypatch.setattr("groundstation.onboard.render.require_whole_video", look)
    assert main(["onboard", "render", "--out", str(tmp_path / "nose"), "--frames", "2"]) == 0
    assert len(seen) == 4
    assert all(name.startswith(".") and ".part." in name for name in seen)
    names = ["imu.csv", "nose.avi", "nose.toml", "truth.csv"]
    assert sorted(path.name for path in (tmp_path / "nose").iterdir()) == names
