"""The pages' tables on drawn worlds are those of the committed summary."""

import json
from pathlib import Path

import bank_notes
import pytest

from groundstation.bank.bank_settings import BankSettings
from groundstation.bank.bank_summary import bank_summary
from groundstation.bank.result_table import table_hash, write_table
from groundstation.simulation.world.world_sets import WorldSet
from tests.bank.drawn_rows import drawn_row
from tests.docs.pages import text_of


def test_the_pages_hold_what_the_committed_summary_gives() -> None:
    """Expected: `python benchmarks/bank_notes.py` changes nothing."""
    summary, baseline = bank_notes.read(bank_notes.SUMMARY), bank_notes.read(bank_notes.BASELINE)
    assert text_of(bank_notes.NOTES) == bank_notes.notes_page(summary, baseline)
    page = text_of(bank_notes.RESULTS)
    assert bank_notes.results_part(summary) in page
    assert bank_notes.with_part(page, bank_notes.results_part(summary)) == page


def test_small_classes_are_not_ranked_and_every_interval_is_shown() -> None:
    share = {
        "factor": "sky", "kind": "dusk", "sessions": 5, "frames": 500, "hit": 0.5, "low": 0.25, "high": 0.75,
        "wrong": 0.004, "excluded": None, "harm": 0.125,
    }  # fmt: skip
    table = bank_notes.factor_table({"factors": [share, share | {"kind": "clear", "sessions": 4}]})
    assert table.splitlines()[2:] == ["| sky | dusk | 5 | 500 | 50.0 % | 25.0 % … 75.0 % | 0.400 % | – | +12.5 |"]


@pytest.mark.parametrize(
    ("title", "shown"), [("ANEES while tracking", "51.6 | 40 … 60"), ("visible hit", "5160.0 % |")]
)
def test_shares_are_in_per_cent_and_statistics_are_not(title: str, shown: str) -> None:
    row = bank_notes.pooled_row({"title": title, "value": 51.6, "low": 40.0, "high": 60.0, "sessions": 3})
    assert row.startswith(f"| {title}")
    assert f" | {shown}" in row
    assert ("NIS" in row) == title.startswith("ANEES")


def test_the_program_is_shown_on_the_worlds_of_the_baseline_alone() -> None:
    """Expected: of worlds 0 to 2, the two that the baseline was run on; none missing."""
    baseline = {
        "settings": {"world_set": "validate", "first": 1, "sessions": 2, "duration_s": 10.0, "frame_hz": 10.0},
        "distributions": [{"column": "baseline_coverage", "quantiles": [0.1] * 5, "count": 2}],
    }
    rows = [{"seed": 1_000_000 + k, "coverage": 0.1 * k} for k in range(3)]
    settings = {"world_set": "validate", "first": 0, "sessions": 3, "duration_s": 10.0, "frame_hz": 10.0}
    table = bank_notes.baseline_table(baseline, bank_notes.same_worlds(rows, settings, baseline))
    title = "share of epochs with an estimate after that"
    assert table.splitlines()[2:] == [
        f"| {title} | baseline | 0.1 | 0.1 | 0.1 | 0.1 | 0.1 | 2 |",
        f"| {title} | program | 0.105 | 0.125 | 0.15 | 0.175 | 0.195 | 2 |",
    ]
    with pytest.raises(SystemExit, match="got 1 of the 2 worlds of the baseline"):
        bank_notes.same_worlds(rows[:2], settings, baseline)
    with pytest.raises(SystemExit, match="wanted sessions as those of the baseline"):
        bank_notes.same_worlds(rows, settings | {"duration_s": 20.0}, baseline)


def bank_of(folder: Path, first: int, count: int, program: str = "0.1.0+abc") -> Path:
    """Write what a bank of drawn rows leaves."""
    folder.mkdir()
    rows = [drawn_row(number, hit=60 + 5 * number) for number in range(first, first + count)]
    settings = BankSettings(world_set=WorldSet.VALIDATE, sessions=count, first=first, duration_s=10.0)
    write_table(folder / "rows.parquet", rows)
    (folder / "bank.json").write_text(json.dumps(bank_summary(settings, rows, (), table_hash(rows), program=program)))
    return folder


def test_two_parts_of_a_bank_are_pooled_as_one(tmp_path: Path) -> None:
    """Expected: in whatever order they are named; not with a world that is missing or counted twice."""
    whole, first = bank_of(tmp_path / "whole", 0, 6), bank_of(tmp_path / "first", 0, 4)
    second = bank_of(tmp_path / "second", 4, 2)
    expected, rows = bank_notes.pooled_banks([whole])
    found, pooled = bank_notes.pooled_banks([second, first])
    assert pooled == rows
    assert json.loads(json.dumps(found)) == expected
    for other in (bank_of(tmp_path / "gap", 5, 2), bank_of(tmp_path / "twice", 3, 2)):
        with pytest.raises(SystemExit, match="wanted worlds that follow each other"):
            bank_notes.pooled_banks([first, other])
    with pytest.raises(SystemExit, match="wanted the same"):
        bank_notes.pooled_banks([first, bank_of(tmp_path / "other", 4, 2, program="0.1.0+def")])
