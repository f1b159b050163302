"""A misspelt key of a file is told with what may have been meant, wherever it is read."""

from pathlib import Path

import pytest

from groundstation.cli.main import main
from groundstation.errors import RigError
from groundstation.files.nearest_word import one_of
from groundstation.files.toml_table import TomlTable
from tests.complaints import complaint


def test_the_nearest_is_named_and_nothing_far() -> None:
    assert one_of("detecter", {"span_m", "detector"}) == "one of detector, span_m; did you mean detector?"
    assert one_of("zzz", {"span_m", "detector"}) == "one of detector, span_m"


def test_a_key_of_the_tuning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "c.toml"
    file.write_text('[detection]\ndetecter = "classic"\n', encoding="utf-8")
    assert main(["config", "--config", str(file)]) == 1
    error = capsys.readouterr().err
    assert "detection: detecter: got an unknown key; wanted one of " in error
    assert error.endswith("; did you mean detector?\n")


def test_a_key_of_a_table() -> None:
    table = TomlTable({"spam_m": 1.0}, "rig.toml", RigError)
    said = complaint(RigError, lambda: table.refuse_unknown({"span_m", "name"}))
    assert said == "rig.toml: spam_m: got an unknown key; wanted one of name, span_m; did you mean span_m?"
