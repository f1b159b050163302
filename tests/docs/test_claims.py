"""What the README and the results claim of the covariance: the figures that are kept, and never one test alone."""

import inspect
import json
import re

import pytest

from groundstation.live.operation import Operation
from tests.docs.pages import ROOT, text_of

KEPT = json.loads((ROOT / "recordings" / "landing-1.figures.json").read_text())
README = text_of(ROOT / "README.md")
RESULTS = text_of(ROOT / "docs" / "results.md")
LIVE = text_of(ROOT / "docs" / "live.md")


def tables_and_paragraphs(text: str) -> list[str]:
    return [part for part in re.split(r"\n\s*\n", text) if part.strip()]


def rows_and_paragraphs(text: str) -> list[str]:
    """Return the paragraphs of a page and the rows of its tables, each row by itself."""
    parts = tables_and_paragraphs(text)
    return [line for part in parts for line in (part.splitlines() if part.startswith("|") else [part])]


def test_the_readme_states_the_kept_anees_and_nis() -> None:
    (anees,) = re.findall(r"on the bundled landing ANEES is ([\d.]+)", README)
    (nis,) = re.findall(r"but NIS ([\d.]+) \(95 % band", README)
    assert float(anees) == pytest.approx(KEPT["truth.all.ekf.anees"], abs=0.005 + 1e-9)
    assert float(nis) == pytest.approx(KEPT["nis.all.mean"], abs=0.005 + 1e-9)


def test_the_readme_s_landing_is_the_kept_one() -> None:
    (row,) = re.findall(r"^\| landing, y 400–485 m \| ([^|]+) \| ([^|]+) \|$", README, re.MULTILINE)
    for method, cell in zip(("ekf", "triangulation"), row, strict=True):
        for axis, figure in zip("xyz", cell.split("/"), strict=True):
            kept = KEPT[f"truth.y400-700.common.{method}.rmse_{axis}_m"]
            assert float(figure) == pytest.approx(kept, abs=0.0005 + 1e-5)


@pytest.mark.parametrize("text", [README, RESULTS[: RESULTS.index("## At a glance")]], ids=["README", "results"])
def test_nis_is_given_with_every_anees(text: str) -> None:
    praised = [part for part in tables_and_paragraphs(text) if "ANEES" in part]
    assert len(praised) >= 2
    assert [part for part in praised if "NIS" not in part] == []


def test_on_the_page_of_results_nis_is_in_each_row_with_anees() -> None:
    praised = [part for part in rows_and_paragraphs(RESULTS) if "ANEES" in part]
    assert len(praised) >= 4
    assert [part for part in praised if not re.search(r"\bNIS\b", part)] == []


def test_results_state_their_development_data() -> None:
    """Expected: the recordings of development are named as such, next to figures of recordings that were not."""
    head = RESULTS[: RESULTS.index("## At a glance")]
    (stated,) = [part for part in tables_and_paragraphs(head) if part.startswith("**What was tuned on what.**")]
    for name in ("landing-1", "takeoff-1", "clips", "landing-clutter"):
        assert name in head
    assert "chosen while looking at `landing-1`, `takeoff-1`" in stated.replace("\n", " ")
    for text in [
        README,
        RESULTS,
        *(text_of(p) for p in (ROOT / "docs" / "notes").glob("*.md")),
        *(p.read_text() for p in (ROOT / "tests").rglob("*.py") if p.name != "test_claims.py"),
    ]:
        assert not re.search(r"nothing (?:was )?tuned (?:to|on) (?:them|landing-1|takeoff-1)\b", text)


def test_the_readme_s_recordings_not_trained_on_are_those_of_the_results() -> None:
    results = (ROOT / "docs" / "results.md").read_text(encoding="utf-8").replace("**", "")
    named = {
        "landing before trees and hills": "landing-clutter",
        "take-off away from the stations, pale wings": "takeoff-away",
    }
    for words, session in named.items():
        ((pairs, rmse, anees, nis),) = re.findall(
            rf"^\| {words} \| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", README, re.M
        )
        (row,) = re.findall(rf"^\| {session} \| ([^|]+) \| ([^|]+) \| [^|]+ \| ([^|]+) \| ([\d.]+) ", results, re.M)
        assert (pairs, rmse, anees, nis) == row
        reached = README.partition("## What it reaches")[2].partition("| RMSE against truth")[0]
        assert anees in reached
        assert nis in reached


def test_how_many_frames_may_wait_is_that_of_operation() -> None:
    """Expected: the bound grows with the stations, and the page has no number of its own for any rig."""
    (bound,) = re.findall(r"^\| frames that wait for the pipeline \| ([^|]+) \|", LIVE, re.MULTILINE)
    assert bound == "one more than there are stations, in all, when a pair begins: 3 of two"
    assert "most=len(self._rig.names) + 1" in inspect.getsource(Operation._core)
