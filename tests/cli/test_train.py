"""`groundstation train` without the extra, and with kinds that do not exist."""

import sys
from pathlib import Path

import pytest

from groundstation.cli.main import main


@pytest.mark.parametrize("command", ["train", "train-proposals"])
def test_without_torch_the_extra_is_named(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.startswith("training.") or name == "torch"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    assert main([command, "--out", str(tmp_path / "run")]) == 1
    assert "groundstation[train]" in capsys.readouterr().err
    assert not (tmp_path / "run" / "aircraft.onnx").exists()
