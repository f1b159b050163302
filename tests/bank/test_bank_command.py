"""`groundstation bank`: settings, page and exit codes, with scores made up instead of rendered worlds."""

import base64
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from groundstation.bank import run_bank
from groundstation.bank.bank_settings import BankSettings, load_bank_settings
from groundstation.bank.dispatcher import FailureKind, JobFailure
from groundstation.bank.map_resumable import MapOutcome
from groundstation.bank.result_store import JobResult
from groundstation.bank.score_world import WorldJob
from groundstation.cli.main import main
from groundstation.errors import ConfigError
from groundstation.simulation.world.world_sets import WorldSet
from tests.bank.drawn_rows import FIRST_SEED, drawn_row

SHEET = base64.b64encode(cv2.imencode(".jpg", np.zeros((24, 96, 3), np.uint8))[1].tobytes()).decode("ascii")


def settings_file(folder: Path, **changes: object) -> Path:
    values = {"format": "groundstation-bank/1", "world_set": "validate", "sessions": 5, "worst": 2, **changes}
    path = folder / "bank.toml"
    path.write_text("".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items()))
    return path


@pytest.fixture
def scored(monkeypatch: pytest.MonkeyPatch) -> list[WorldJob]:
    """Replace the workers: world number k has 20 k of 100 frames hit, and number 4 fails."""
    jobs: list[WorldJob] = []

    def score(
        function: Callable[..., Any], items: Mapping[str, WorldJob], out: Path, *_: object, **__: object
    ) -> MapOutcome:
        jobs.extend(items.values())
        results, failures = [], []
        for name, job in items.items():
            number = job.seed % FIRST_SEED
            if number == 4:
                failures.append(JobFailure(name=name, kind=FailureKind.TIMED_OUT, reason="took longer than 3600 s"))
                continue
            row = drawn_row(number, hit=20 * number, sky="clear" if number else "dusk <& more>") | {"seed": job.seed}
            results.append(JobResult(name=name, value={"row": row, "sheet": SHEET}, elapsed_s=1.0, cpu_s=1.0))
        return MapOutcome(results=tuple(results), failures=tuple(failures), reused=1)

    monkeypatch.setattr(run_bank, "map_resumable", score)
    return jobs


def test_rows_page_and_summary_are_written_and_a_failure_is_stated(
    scored: list[WorldJob], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bank", str(settings_file(tmp_path)), "--out", str(tmp_path / "out")]) == 1
    assert [job.seed for job in scored] == [FIRST_SEED + k for k in range(5)]
    said = capsys.readouterr()
    assert "visible frames hit:" in said.out
    assert " 30.0 %" in said.out
    assert "world-1000004: timed out: took longer than 3600 s" in said.err
    assert [row["hit"] for row in pq.read_table(tmp_path / "out" / "rows.parquet").to_pylist()] == [0, 20, 40, 60]
    summary = json.loads((tmp_path / "out" / "bank.json").read_text())
    assert summary["worst"] == [FIRST_SEED, FIRST_SEED + 1]
    assert summary["failed"][0]["name"] == "world-1000004"
    page = (tmp_path / "out" / "bank.html").read_text()
    assert page.count("data:image/jpeg;base64,") == 2
    assert "groundstation simulate --world 1000000 --duration 20 --rate 10" in page
    assert "dusk &lt;&amp; more&gt;" in page
    assert "<& more>" not in page


def test_a_run_of_the_test_set_needs_a_log_and_is_logged(
    scored: list[WorldJob], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = settings_file(tmp_path, world_set="test", sessions=3)
    assert main(["bank", str(settings), "--out", str(tmp_path / "out")]) == 2
    assert "--test-log" in capsys.readouterr().err
    assert not scored
    log = tmp_path / "runs.csv"
    for runs in (1, 2):
        assert main(["bank", str(settings), "--out", str(tmp_path / "out"), "--test-log", str(log)]) == 0
        rows = log.read_text().splitlines()[1:]
        assert len(rows) == runs
        assert rows[-1].split(",")[3:6] == ["0", "3", "20.0 %"]


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"format": "groundstation-bank/2"}, "groundstation-bank/1"),
        ({"world_set": "holdout"}, "train"),
        ({"sessions": 0}, "sessions"),
        ({"sessions": 2.5}, "sessions"),
        ({"first": -1}, "first"),
        ({"first": 999_999, "sessions": 2}, "sessions"),
        ({"duration_s": 0}, "duration_s"),
        ({"duration_s": 1.0}, "duration_s: got 1.0; wanted from 2 to 300"),
        ({"limit": 5}, "limit"),
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(changes: dict[str, object], wanted: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=wanted) as refused:
        load_bank_settings(settings_file(tmp_path, **changes))
    assert "bank.toml" in str(refused.value)


def test_seeds_are_those_of_the_set() -> None:
    assert BankSettings(world_set=WorldSet.TEST, sessions=2, first=7).seeds == (2_000_007, 2_000_008)
    assert BankSettings(world_set=WorldSet.TRAIN, sessions=1).seeds == (0,)
