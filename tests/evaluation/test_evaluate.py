"""The whole evaluation: summary, table and page of a run made from a known path."""

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from groundstation.errors import InputError
from groundstation.evaluation.accuracy_table import format_accuracy_table
from groundstation.evaluation.collector import ResultCollector
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.evaluate import Evaluation, evaluate_run, write_summary
from groundstation.evaluation.figures import pictures
from groundstation.evaluation.html_report import report_page, write_report
from groundstation.evaluation.run_description import RunDescription
from groundstation.messages import DgpsFix, StepReport, TrackEvent
from groundstation.rig.rig import Rig
from tests.evaluation.synthetic import PSD, Path3D, Phase, approach, blind_report, fixes_of, reports_on, run_on

RUN = RunDescription(
    name="landing <1>",
    phases=(Phase(from_s=0.5, to_s=26.2, background="sky"), Phase(from_s=26.3, to_s=40.0, background="ground")),
    acceleration_psd_m2_s3=PSD,
    configuration={"detection": {"roi": [250, 100]}},
    speed={"times_real_time": 5.5, "imports_s": 1.25},
)


@pytest.fixture(scope="module")
def evaluation(
    landing_run: ResultCollector, landing_truth: Path3D, landing_fixes: list[DgpsFix], rig: Rig
) -> Evaluation:
    return evaluate_run(landing_run, RUN, rig=rig, config=EvaluationConfig(), dgps=landing_fixes, truth=landing_truth)


def _no_nan(value: Any) -> bool:
    if isinstance(value, dict):
        return all(_no_nan(v) for v in value.values())
    if isinstance(value, list):
        return all(_no_nan(v) for v in value)
    return not isinstance(value, float) or bool(np.isfinite(value))


def test_summary_agrees_with_a_plain_calculation(
    evaluation: Evaluation, landing_run: ResultCollector, landing_truth: Path3D
) -> None:
    """Expected: the same RMSE as subtracting the truth row by row (the epochs are the truth's own times)."""
    error = landing_run.epochs()["position_m"] - landing_truth.position_runway_m
    table = evaluation.summary["accuracy"]["truth"]
    np.testing.assert_allclose(table["total"]["ekf"]["rmse_m"], np.sqrt((error**2).mean(axis=0)), rtol=1e-9)
    y = landing_truth.position_runway_m[:, 1]
    inside = (y >= 100) & (y < 150)
    row = next(r for r in table["by_range"] if r["from_m"] == 100.0)
    assert row["reference_epochs"] == inside.sum()
    np.testing.assert_allclose(row["common"]["ekf_rmse_m"], np.sqrt((error[inside] ** 2).mean(axis=0)), rtol=1e-9)


def test_a_consistent_run_is_called_consistent(evaluation: Evaluation) -> None:
    """Expected: ANEES near 1 and triangulation on its bound, because this run's noise is as stated.

    The reading noise is that of the rig and no reading is interpolated.
    """
    table = evaluation.summary["accuracy"]["truth"]
    assert 0.6 < table["anees"]["mean"] < 1.6
    np.testing.assert_allclose(table["total"]["bound"]["triangulation_over_fix"], 1.0, atol=0.2)
    np.testing.assert_allclose(table["total"]["bound"]["ekf_over_track"], 1.0, atol=0.4)
    nis = evaluation.summary["nis"]["all"]
    assert nis["low_95"] < 1.0 < nis["high_95"]


def test_dgps_and_truth_agree_on_the_common_part(evaluation: Evaluation) -> None:
    dgps, truth = (evaluation.comparisons[k] for k in ("dgps", "truth"))
    both = dgps.ekf_known & truth.ekf_known
    np.testing.assert_allclose(dgps.ekf_error_m[both], truth.ekf_error_m[both], atol=0.4)
    assert evaluation.summary["reference"]["time_offset"]["offset_s"] == pytest.approx(0.3, abs=0.015)


def test_summary_is_json_without_nan(evaluation: Evaluation, tmp_path: Path) -> None:
    write_summary(tmp_path / "summary.json", evaluation)
    read = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert _no_nan(read)
    assert read["format"] == "groundstation-summary/1"
    assert read["counts"]["track"]["tracking"] == 332
    assert read["configuration"] == {"detection": {"roi": [250, 100]}}
    assert {"python", "numpy", "numba", "filterpy", "groundstation"} <= set(read["versions"])


def test_summary_that_cannot_be_written_is_an_input_error(evaluation: Evaluation, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="missing"):
        write_summary(tmp_path / "missing" / "summary.json", evaluation)


def test_table_fits_a_terminal(evaluation: Evaluation) -> None:
    text = format_accuracy_table(evaluation.summary)
    lines = text.splitlines()
    assert max(len(line) for line in lines) <= 100
    assert "against the truth" in text
    assert "against DGPS" in text
    assert re.search(r"t_dgps = t_session \+0\.\d{4} s ± \d+\.\d ms", text)
    rows = [line for line in lines if line.count("│") == 3]
    assert len({tuple(k for k, c in enumerate(line) if c == "│") for line in rows}) == 1


def test_page_is_self_contained_and_names_are_escaped(evaluation: Evaluation, tmp_path: Path) -> None:
    write_report(tmp_path / "report.html", evaluation, EvaluationConfig())
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert len(page) < 3_000_000
    assert "landing &lt;1&gt;" in page
    # the plots' own scripts are in the page
    assert not re.search(r"<script[^>]*\ssrc\b", page)
    assert not re.search(r"(src|href)\s*=\s*['\"](https?:)?//", page)
    pictures = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert len(pictures) == 8
    for picture in pictures:
        ET.fromstring(picture)


def test_excluded_data_are_reported_everywhere(
    landing_run: ResultCollector, landing_truth: Path3D, landing_fixes: list[DgpsFix], rig: Rig
) -> None:
    """Expected: a held log is named frozen in summary, table and page, and lowers the number of compared epochs."""
    held = [replace(f, position_runway_m=landing_fixes[150].position_runway_m) for f in landing_fixes[150:]]
    fixes = [*landing_fixes[:150], *held]
    found = evaluate_run(landing_run, RUN, rig=rig, config=EvaluationConfig(), dgps=fixes, truth=landing_truth)
    (span,) = found.summary["reference"]["excluded"]
    assert span["reason"] == "frozen"
    assert "frozen" in format_accuracy_table(found.summary)
    assert "frozen" in report_page(found, EvaluationConfig())
    assert found.summary["accuracy"]["dgps"]["total"]["reference_epochs"] < 160


def test_the_page_is_the_same_each_time(evaluation: Evaluation) -> None:
    assert report_page(evaluation, EvaluationConfig()) == report_page(evaluation, EvaluationConfig())


def test_run_without_any_reference_still_reports(landing_run: ResultCollector, rig: Rig) -> None:
    """Expected: no accuracy, the fault stated, everything else written."""
    run = replace(RUN, faults=("dgps.csv row 7: got 'abc'; wanted a number",))
    found = evaluate_run(landing_run, run, rig=rig, config=EvaluationConfig())
    assert found.summary["accuracy"] == {}
    assert found.summary["counts"]["track"]["tracking"] == 332
    assert "dgps.csv row 7" in format_accuracy_table(found.summary)
    assert "dgps.csv row 7" in report_page(found, EvaluationConfig())


def test_run_that_never_found_anything(rig: Rig, landing_truth: Path3D) -> None:
    """Expected: zero coverage, nulls for errors, counted misses, a page and a table all the same."""
    collector = ResultCollector()
    for k in range(5):
        collector.write(blind_report(1.0 + 0.1 * k, k))
    fixes = fixes_of(landing_truth, 0.3, np.random.default_rng(1))
    found = evaluate_run(collector, RUN, rig=rig, config=EvaluationConfig(), dgps=fixes, truth=landing_truth)
    total = found.summary["accuracy"]["truth"]["total"]
    assert total["ekf"] == {
        "epochs": 0, "coverage": 0.0, "rmse_m": None, "mean_m": None, "p95_m": None, "max_m": None
    }  # fmt: skip
    assert found.summary["counts"]["detection"]["left"]["miss_reason"]["low_contrast"] == 5
    assert "not found in any" in report_page(found, EvaluationConfig())
    assert "0" in format_accuracy_table(found.summary)
    assert _no_nan(found.summary)


def test_run_without_epochs(rig: Rig) -> None:
    found = evaluate_run(ResultCollector(), RUN, rig=rig, config=EvaluationConfig())
    assert _no_nan(found.summary)
    assert "no epoch" in format_accuracy_table(found.summary)
    assert "No stereo pair" in report_page(found, EvaluationConfig())


def test_interrupted_track_leaves_gaps_not_numbers(rig: Rig, rng: np.random.Generator) -> None:
    """Expected: epochs without an estimate lower the coverage and enter no error."""
    path = approach(seconds=10.0)
    collector = ResultCollector()
    for k, report in enumerate(reports_on(path, rig, rng)):
        collector.write(blind_report(float(path.t_s[k]), k) if 40 <= k < 60 else report)
    found = evaluate_run(collector, RUN, rig=rig, config=EvaluationConfig(), truth=path)
    total = found.summary["accuracy"]["truth"]["total"]
    assert total["ekf"]["coverage"] == pytest.approx(0.8)
    assert total["ekf"]["epochs"] == 80
    assert _no_nan(found.summary)


def test_unusable_covariances_do_not_stop_the_evaluation(rig: Rig, rng: np.random.Generator) -> None:
    """Expected: zero, singular and infinite covariances are survived; what is not a number is no estimate."""
    path = approach(seconds=6.0)
    collector = ResultCollector()
    for k, report in enumerate(reports_on(path, rig, rng)):
        kinematics = report.estimates[0].kinematics
        assert kinematics is not None
        if k % 4 == 0:
            kinematics.covariance[:] = 0.0
        if k % 4 == 1:
            kinematics.covariance[:] = 1e4
        if k == 2:
            kinematics.covariance[0, 0] = np.inf
        collector.write(report)
    fixes = fixes_of(path, 0.1, rng)
    found = evaluate_run(collector, RUN, rig=rig, config=EvaluationConfig(), dgps=fixes, truth=path)
    assert found.summary["accuracy"]["truth"]["total"]["ekf"]["epochs"] == 59
    assert _no_nan(found.summary)
    assert report_page(found, EvaluationConfig())


def test_collector_keeps_an_hour_in_a_few_megabytes(rig: Rig, rng: np.random.Generator) -> None:
    collector = ResultCollector()
    (report,) = reports_on(approach(seconds=0.1), rig, rng)
    for _ in range(3600):
        collector.write(report)
    assert 10 * collector.nbytes < 15e6


def test_collector_keeps_events_up_to_a_limit() -> None:
    collector = ResultCollector()
    for k in range(1200):
        collector.write(StepReport(events=(TrackEvent(t_s=float(k), level="info", text="x"),)))
    assert len(collector.events) == 1000
    assert collector.events_dropped == 200


def test_each_range_bin_of_the_configuration_appears(rig: Rig, rng: np.random.Generator) -> None:
    path = approach(seconds=10.0)
    config = EvaluationConfig(range_bins_m=(0.0, 380.0, 420.0))
    found = evaluate_run(run_on(path, rig, rng), RUN, rig=rig, config=config, truth=path)
    rows = found.summary["accuracy"]["truth"]["by_range"]
    assert [(r["from_m"], r["to_m"]) for r in rows] == [(0.0, 380.0), (380.0, 420.0), (420.0, None)]
    assert sum(r["reference_epochs"] for r in rows) == 100


@pytest.mark.parametrize("edges", [(), (5.0, 5.0), (10.0, 0.0)])
def test_range_bins_must_rise(edges: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="rising"):
        EvaluationConfig(range_bins_m=edges)


def test_the_pictures_of_a_part_show_only_the_phases_in_it(
    landing_run: ResultCollector, landing_truth: Path3D, rig: Rig
) -> None:
    """Expected: phases end where the epochs do, one outside is left out, and no picture reaches beyond the epochs."""
    first_s, last_s = (float(landing_run.epochs()["t_s"][k]) for k in (0, -1))
    middle_s = (first_s + last_s) / 2
    whole = (
        Phase(from_s=first_s - 50.0, to_s=middle_s, background="sky"),
        Phase(from_s=middle_s, to_s=last_s + 60.0, background="ground"),
        Phase(from_s=last_s + 60.0, to_s=last_s + 90.0, background="mixed"),
    )
    run = replace(RUN, phases=whole)
    part = evaluate_run(landing_run, run, rig=rig, config=EvaluationConfig(), truth=landing_truth)
    assert [(p.from_s, p.to_s, p.background) for p in part.run.phases] == [
        (first_s, middle_s, "sky"),
        (middle_s, last_s, "ground"),
    ]
    room_s = 0.1 * (last_s - first_s)
    for picture in pictures(part, EvaluationConfig().range_bins_m):
        if picture.name.startswith(("errors", "nees", "nis", "latency")):
            figure = Figure()
            picture.draw(figure)
            low_s, high_s = figure.axes[-1].get_xlim()
            assert first_s - room_s < low_s < high_s < last_s + room_s, picture.name
