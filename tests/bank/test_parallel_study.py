"""A study's lines are independent of the number of workers, and an interrupted study is resumed."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from tests.bank import toy_study
from tests.conftest import DASK_START

pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="extra cluster is not installed")

RUNS = 10
ROOT = Path(__file__).resolve().parents[2]


def expected(scale: int = 1, runs: int = RUNS) -> str:
    return f"{runs} runs, mean {np.mean([scale * np.random.default_rng(seed).normal() for seed in range(runs)])!r}\n"


def computed(marks: Path) -> dict[str, int]:
    return {path.name: len(path.read_text().split()) for path in marks.iterdir()}


def test_an_interrupted_study_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without Dask, interrupted in the second of three blocks; then with two workers, for which the first is found."""
    marks, out = tmp_path / "marks", tmp_path / "out"
    marks.mkdir()
    (marks / "interrupt").write_text("5")
    arguments = [str(marks), "--out", str(out), "--workers", "2"]
    with monkeypatch.context() as without_dask:
        without_dask.setitem(sys.modules, "distributed", None)
        with pytest.raises(SystemExit) as ended:
            toy_study.main(arguments)
    shown = capsys.readouterr()
    assert ended.value.code == 130
    assert shown.out == ""
    assert "groundstation[cluster]'; until then one job runs after the other" in shown.err
    assert f"interrupted; the same command goes on with what is in {out}" in shown.err
    assert computed(marks) == {"0": 1}
    toy_study.main(arguments)
    assert capsys.readouterr().out == expected()
    assert computed(marks) == {"0": 1, "4": 1, "8": 1}


def test_a_script_prints_the_same_with_one_worker(tmp_path: Path) -> None:
    """Its function, which is of ``__main__``, is imported by the worker."""
    (tmp_path / "toy_script.py").write_text((ROOT / "tests" / "bank" / "toy_study.py").read_text())
    found = subprocess.run(
        [sys.executable, "toy_script.py", ".", "--out", "out", "--workers", "1"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'benchmarks'}", DASK_START: "spawn"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout == expected()


def test_other_options_are_computed_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """More runs use the blocks that are whole and the same; another scale uses none."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    marks, out = tmp_path / "marks", ["--out", str(tmp_path / "out")]
    marks.mkdir()
    for options, text, blocks in (
        ([], expected(), {"0": 1, "4": 1, "8": 1}),
        ([], expected(), {"0": 1, "4": 1, "8": 1}),
        (["--runs", "12"], expected(runs=12), {"0": 1, "4": 1, "8": 2}),
        (["--scale", "2"], expected(scale=2), {"0": 2, "4": 2, "8": 3}),
    ):
        toy_study.main([str(marks), *out, *options])
        assert capsys.readouterr().out == text
        assert computed(marks) == blocks


def test_a_failed_job_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One of three jobs cannot leave its mark. Expected: it is named, and the others are kept."""
    marks, out = tmp_path / "marks", tmp_path / "out"
    (marks / "4").mkdir(parents=True)
    with pytest.raises(SystemExit, match=r"^1 of 3 jobs failed; the others are kept in "):
        toy_study.main([str(marks), "--out", str(out), "--workers", "1"])
    assert "block-4-" in capsys.readouterr().err
    assert len(list(out.glob("*.json"))) == 2
