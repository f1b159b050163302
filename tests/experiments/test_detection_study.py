"""The study of the paper's detection experiments: it repeats exactly, and its tables match the outcomes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.box import Box
from groundstation.detection.config import DetectionConfig
from groundstation.detection.detector import warm_up
from groundstation.errors import SessionError
from groundstation.experiments import detection_plots as plots
from groundstation.experiments import detection_tables as findings
from groundstation.experiments.detector_outcomes import DetectorOutcome, watch
from groundstation.experiments.truth_scenes import TruthScene, scenes
from groundstation.session import load_session

SEED = 3
FULL = "full frame"
CONFIGS = {"250×100": DetectionConfig(), FULL: DetectionConfig(roi_basic_px=(100_000, 100_000))}


def first_scenes(folder: Path) -> list[TruthScene]:
    return list(scenes(load_session(folder), SEED, first_epoch=4, last_epoch=10, every=3))


@pytest.fixture(scope="module")
def outcomes(landing_1: Path) -> dict[str, list[DetectorOutcome]]:
    warm_up()
    return watch(first_scenes(landing_1), CONFIGS, lambda number: None)


def made_up(**changes: object) -> DetectorOutcome:
    """An outcome with a point 3 px right of the nose, stated at 2 px."""
    plain = DetectorOutcome(
        station="left",
        t_s=1.0,
        background="sky",
        width_px=50,
        roi=Box(0, 0, 100, 60),
        elapsed_s=0.01,
        segment_s=0.004,
        reason="found",
        point_px=np.array([53.0, 30.0]),
        error_px=np.array([3.0, 0.0]),
        whitened=np.array([1.5, 0.0]),
        covariance_px2=4.0 * np.eye(2),
        noise_px2=0.25 * np.eye(2),
        overlap=0.7,
        centre_error_px=1.0,
        holds_nose=True,
        holds_silhouette=True,
    )
    return replace(plain, **changes)  # type: ignore[arg-type]


def test_every_third_pair_of_both_cameras_is_shown(landing_1: Path) -> None:
    seen = [(s.frame.epoch, s.frame.station) for s in first_scenes(landing_1)]
    assert seen == [(k, name) for k in (4, 7, 10) for name in ("left", "right")]


def test_predictions_are_off_by_the_noise_that_they_state(landing_1: Path) -> None:
    shown = list(scenes(load_session(landing_1), SEED, last_epoch=60))
    off = np.array([s.hint.predicted_px - s.nose_px for s in shown])
    spread = np.array([s.hint.predicted_covariance_px2 for s in shown]).mean(axis=0)
    assert off.std(axis=0) == pytest.approx(np.sqrt(np.diag(spread)), rel=0.2)
    assert all(s.hint.forward_px_per_m is not None and s.hint.height_m is not None for s in shown)


def test_the_study_repeats_to_the_last_digit(landing_1: Path, outcomes: dict[str, list[DetectorOutcome]]) -> None:
    numbers: list[int] = []
    again = watch(first_scenes(landing_1), CONFIGS, numbers.append)
    assert numbers == [1, 2, 3, 4, 5, 6]
    for name, first in outcomes.items():
        for a, b in zip(first, again[name], strict=True):
            assert (a.roi, a.reason, a.overlap) == (b.roi, b.reason, b.overlap)
            assert np.array_equal(a.error_px, b.error_px, equal_nan=True)


def test_on_the_bundled_landing_the_nose_is_found_inside_the_region(outcomes: dict[str, list[DetectorOutcome]]) -> None:
    for found in outcomes["250×100"]:
        assert found.found
        assert not found.wrong
        assert found.holds_nose
        assert found.holds_silhouette
        assert found.overlap > 0.4
        assert 0 < found.segment_s < found.elapsed_s


def test_a_region_without_all_of_the_silhouette_is_counted(landing_1: Path) -> None:
    narrow = {"narrow": DetectionConfig(roi_basic_px=(8, 60), roi_sigmas=0.0)}
    one = watch(first_scenes(landing_1)[:1], narrow, lambda number: None)["narrow"][0]
    assert not one.holds_silhouette


@pytest.mark.parametrize(("off", "width", "wrong"), [(9.0, 20, False), (11.0, 20, True), (20.0, 100, False)])
def test_a_point_is_wrong_beyond_ten_px_and_a_quarter_of_the_width(off: float, width: int, wrong: bool) -> None:
    assert made_up(error_px=np.array([0.0, off]), width_px=width).wrong is wrong


def test_tables_count_misses_deviations_and_consistency() -> None:
    missed = made_up(reason="no_region", overlap=0.0, background="ground", t_s=1.1)
    moved = made_up(point_px=np.array([55.0, 31.0]), t_s=1.1)
    sweep = findings.roi_table({"a": [made_up(), moved], FULL: [made_up(), made_up(t_s=1.1)]}, FULL, {"a": "theirs"})
    row = dict(zip(sweep.columns, sweep.rows[0], strict=True))
    assert row["mean deviation u px"] == 1.0
    assert row["largest v"] == 1.0
    assert row["paper"] == "theirs"
    methods = {"ours": [made_up(), missed]}
    failures = findings.failure_table(methods)
    assert dict(zip(failures.columns, failures.rows[0], strict=True))["missed: no region"] == 1
    by_phase = {(r[0], r[1]): r for r in findings.method_table(methods, {}).rows}
    assert by_phase["all", "ours"][7] == 50.0
    accuracy = findings.accuracy_table([made_up(), made_up(t_s=1.1)])
    row = dict(zip(accuracy.columns, accuracy.rows[0], strict=True))
    assert row["rms u px"] == 3.0
    assert row["NIS per dof"] == pytest.approx(1.125)
    assert row["lag-1 correlation"] == pytest.approx(1.0)


def test_tables_and_pictures_are_written(tmp_path: Path, outcomes: dict[str, list[DetectorOutcome]]) -> None:
    table = findings.accuracy_table(outcomes["250×100"])
    table.write_csv(tmp_path)
    assert len((tmp_path / "accuracy.csv").read_text().splitlines()) == 1 + len(table.rows)
    assert table.markdown().count("\n| ") == 1 + len(table.rows)
    plots.draw_roi_sweep(outcomes, FULL, tmp_path / "roi.png")
    plots.draw_methods(outcomes, tmp_path / "methods.png")
    plots.draw_accuracy(outcomes["250×100"], tmp_path / "accuracy.png")
    assert all((tmp_path / f"{name}.png").stat().st_size > 5000 for name in ("roi", "methods", "accuracy"))


def test_a_session_without_truth_is_refused(landing_1: Path, tmp_path: Path) -> None:
    for path in landing_1.iterdir():
        if path.name != "truth.csv":
            (tmp_path / path.name).symlink_to(path)
    with pytest.raises(SessionError, match="wanted a rendered session"):
        next(scenes(load_session(tmp_path), SEED))


def test_a_replay_is_evaluated_by_background_and_width() -> None:
    """Expected: rms and percent of the width of each bin, misses counted, and the ranges with a target value."""
    far = [made_up(t_s=0.1 * k, error_px=np.array([1.0, -2.0]), overlap=0.5 + 0.1 * k) for k in range(3)]
    missed = made_up(reason="no_region", error_px=np.full(2, np.nan), overlap=0.0, holds_silhouette=False)
    near = made_up(background="ground", width_px=150)
    table = findings.flown_table([*far, missed, near])
    rows = {(row[0], row[1]): row[2:] for row in table.rows}
    sky = ("30–60 px", "15–100 px", "0–80 px")
    elsewhere = ("elsewhere", "all but sky below 100 px")
    assert set(rows) == {*(("sky", name) for name in sky), ("ground", "120–200 px"), elsewhere, ("all", "")}
    assert rows[elsewhere][:6] == rows["ground", "120–200 px"][:6]
    for name in sky:
        assert rows["sky", name][:7] == pytest.approx([4, 75.0, 1.0, 2.0, 2.0, 4.0, 0.55])
        assert rows["sky", name][-2:] == pytest.approx([100.0, 75.0])
    assert rows["ground", "120–200 px"][2:6] == pytest.approx([3.0, 0.0, 2.0, 0.0])
    assert rows["all", ""][0] == 5
