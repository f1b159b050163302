"""The text table of accuracy: every line that a summary has numbers for."""

import json

from groundstation.evaluation.accuracy_table import _accuracy_block
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
