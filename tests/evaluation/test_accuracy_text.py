"""The text table of accuracy: every line that a summary has numbers for."""

import json

from groundstation.evaluation.accuracy_table import _accuracy_block, format_accuracy_table
from tests.conftest import ROOT


def test_all_lines_are_there() -> None:
    summary = json.loads((ROOT / "tests" / "session" / "data" / "summary.json").read_text(encoding="utf-8"))
    table = summary["accuracy"]["truth"]
    lines = _accuracy_block("against truth", table).splitlines()
    ratio = table["total"]["bound"]["ekf_over_track"]
    (bound,) = [line for line in lines if line.startswith("RMSE / bound x y z")]
    assert f"{ratio[0]:.2f}" in bound
    assert f"{table['total']['bound']['triangulation_over_fix'][1]:.2f}" in bound
    assert sum(line.startswith("y ") for line in lines) == len(table["by_range"])
    assert any(line.startswith("coverage: EKF 91.3 %") for line in lines)
    assert any(line.startswith("ANEES 0.49") for line in lines)
    assert sum(" alone: RMSE " in line for line in lines) == 2


def test_nees_and_nis_are_explained_once() -> None:
    """Expected: the ideal and the band that the sample admits; of the second reference the band alone."""
    summary = json.loads((ROOT / "tests" / "session" / "data" / "summary.json").read_text(encoding="utf-8"))
    summary["accuracy"] = {"truth": summary["accuracy"]["truth"], "dgps": summary["accuracy"]["truth"]}
    text = " ".join(format_accuracy_table(summary).split())
    anees, nis = summary["accuracy"]["truth"]["anees"], summary["nis"]["all"]
    meaning = "on average: 1 when that covariance is true, less when it is too large"
    assert text.count(meaning) == 1
    assert text.count(f"the sample admits {anees['low_95']:.2f} … {anees['high_95']:.2f}") == 2
    assert text.index("ANEES") < text.index(meaning)
    assert f"NIS {nis['mean']:.2f}: squared distance of the pixels from their prediction" in text
    assert max(len(line) for line in format_accuracy_table(summary).splitlines()) <= 98


def test_without_a_track_nothing_is_held_against_the_reference() -> None:
    summary = json.loads((ROOT / "tests" / "session" / "data" / "summary.json").read_text(encoding="utf-8"))
    summary["reference"] = {**summary["reference"], "fixes": 261, "time_offset": None}
    assert "DGPS: 261 fixes, not usable" in format_accuracy_table(summary)
    summary["no_track"] = "no track: in none of 40 pairs"
    text = format_accuracy_table(summary)
    assert "DGPS: 261 fixes, not compared without a track" in text
    assert "not usable" not in text
