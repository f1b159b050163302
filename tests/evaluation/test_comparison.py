"""`evaluate`: comparison of runs, differences, CSV, JSON, and evo's errors of our trajectories."""

import copy
import csv
import json
import os
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.evaluation.accuracy_table import format_accuracy_table
from groundstation.evaluation.comparison_text import format_comparison
from groundstation.evaluation.key_figures import FigureChange, figures_of, moved_figures
from groundstation.replay.compare import CompareRequest, compare, comparison_csv, comparison_json, load_summary
from groundstation.simulation import case_b, simulate
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.session_folder import write_session_folder
from tests.peers import absent

pytestmark = pytest.mark.usefixtures("unrendered_figures")

ROOT = Path(__file__).resolve().parents[2]
EVO_TOLERANCE = 0.01


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sessions") / "glide"
    flight = simulate(case_b(seed=5, trajectory=GlideApproach(start_y_m=350.0, end_y_m=120.0)))
    write_session_folder(folder, flight, name="glide")
    return folder


@pytest.fixture(scope="module")
def compared(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two tunings of one session, replayed and evaluated by the command."""
    work = tmp_path_factory.mktemp("compared")
    (work / "usual.toml").write_text("")
    (work / "loose.toml").write_text("[estimation]\nacceleration_psd_m2_s3 = [500.0, 900.0, 500.0]\n")
    arguments = ["evaluate", str(session), "--out", str(work / "runs")]
    arguments += ["--config", str(work / "usual.toml"), "--config", str(work / "loose.toml")]
    assert main([*arguments, "--csv", str(work / "c.csv"), "--json", str(work / "c.json")]) == 0
    return work


@pytest.mark.parametrize("kind", ["--csv", "--json"])
def test_a_missing_folder_is_reported_and_not_created(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    path = tmp_path / "none" / "x.csv"
    assert main(["evaluate", str(session), "--out", str(tmp_path / "runs"), kind, str(path)]) == 1
    assert f"{path}: got no folder {path.parent}; wanted a file in a folder that is there" in capsys.readouterr().err
    # nor is anything replayed before
    assert list(tmp_path.iterdir()) == []


def summary(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "summary.json").read_text())


def test_the_figures_are_the_summarys(compared: Path) -> None:
    figures = figures_of(summary(compared / "runs" / "usual"))
    truth = summary(compared / "runs" / "usual")["accuracy"]["truth"]
    for k, axis in enumerate("xyz"):
        assert figures[f"truth.all.ekf.rmse_{axis}_m"] == truth["total"]["ekf"]["rmse_m"][k]
    (near,) = [g for g in truth["by_range"] if g["from_m"] == 150]
    assert figures["truth.y150-250.triangulation.rmse_y_m"] == near["triangulation"]["rmse_m"][1]
    assert figures["truth.all.ekf.anees"] == pytest.approx(truth["anees"]["mean"])
    assert figures["misses.left.no_region"] >= 0


def test_the_table_and_the_json_agree(compared: Path) -> None:
    with (compared / "c.csv").open(newline="") as file:
        rows = {(r["run"], r["figure"]): r for r in csv.DictReader(file)}
    whole = json.loads((compared / "c.json").read_text())
    assert whole["baseline"] == "usual"
    assert [run["name"] for run in whole["runs"]] == ["usual", "loose"]
    usual, loose = whole["runs"]
    assert loose["configuration"]["estimation"]["acceleration_psd_m2_s3"] == [500.0, 900.0, 500.0]
    for name, value in loose["figures"].items():
        row = rows["loose", name]
        assert float(row["value"]) == pytest.approx(value, rel=1e-6)
        if name in usual["figures"]:
            before = usual["figures"][name]
            assert float(row["baseline"]) == pytest.approx(before, rel=1e-6)
            assert loose["difference"][name] == pytest.approx(value - before)
    assert set(usual["difference"].values()) == {0.0}
    # a filter with hundreds of times less process noise follows the noise
    assert loose["difference"]["truth.y250-400.ekf.rmse_y_m"] > 0.0


def test_the_printed_table_has_rows_settings_and_differences(
    compared: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [str(compared / "runs" / name) for name in ("usual", "loose")]
    assert main(["evaluate", *runs, "--baseline", "loose"]) == 0
    printed = capsys.readouterr().out
    assert "against the truth, differences to loose" in printed
    assert "usual: estimation.acceleration_psd_m2_s3 = [1.0, 4.0, 1.5] (loose: [500.0, 900.0, 500.0])" in printed
    (row,) = [line for line in printed.splitlines() if line.startswith("all ") and "usual" in line]
    before, after = (summary(Path(run))["accuracy"]["truth"]["total"]["ekf"]["rmse_m"][1] for run in runs[::-1])
    assert f"{100 * (after - before) / before:+.0f}" in row.split("│")[2].split()
    assert "misses, usual:" in printed


def test_the_errors_of_triangulation_are_in_the_report_as_well(
    compared: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: `evaluate` uses all pairs of each method; table and report agree with it next to those of both."""
    run = compared / "runs" / "loose"
    assert main(["evaluate", str(run)]) == 0
    printed = capsys.readouterr().out
    assert "each on all pairs where it has a position" in printed
    (row,) = [line for line in printed.splitlines() if line.startswith("all ")]
    shown = row.split("│")[4].split()
    own = summary(run)["accuracy"]["truth"]["total"]["triangulation"]["rmse_m"]
    assert shown == [f"{value:.3f}" for value in own]
    page = (run / "report.html").read_text(encoding="utf-8")
    assert f"Triangulation on all of its pairs: RMSE {' / '.join(shown)} m" in page
    assert f"triangulation alone: RMSE {'/'.join(shown)}" in format_accuracy_table(summary(run))


def test_a_baseline_may_be_a_folder_that_is_not_among_the_runs(compared: Path, tmp_path: Path) -> None:
    usual, loose = (compared / "runs" / name for name in ("usual", "loose"))
    result = compare(CompareRequest(sources=(loose,), work=tmp_path, baseline=str(usual)))
    assert [run.name for run in result.runs] == ["usual", "loose"]
    assert result.baseline.name == "usual"
    with pytest.raises(InputError, match="no such run or folder"):
        compare(CompareRequest(sources=(loose,), work=tmp_path, baseline="nowhere"))


def test_runs_of_other_length_are_compared_with_a_word(
    compared: Path, session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    usual, loose = (compared / "runs" / name for name in ("usual", "loose"))
    assert compare(CompareRequest(sources=(usual, loose), work=tmp_path)).notes == ()
    assert main(["replay", str(session), "--out", str(tmp_path / "part"), "--to", "3", "--no-rerun"]) == 0
    capsys.readouterr()
    assert main(["evaluate", str(usual), str(tmp_path / "part")]) == 0
    reported = capsys.readouterr().err
    whole, part = (summary(folder)["session"] for folder in (usual, tmp_path / "part"))
    assert whole["epochs"] > part["epochs"] > 10
    assert f"note: part has {part['epochs']} pairs from {part['from_s']:g} to {part['to_s']:g} s, usual" in reported
    assert (
        f"usual {whole['epochs']} pairs from {whole['from_s']:g} to {whole['to_s']:g} s: not the same pairs" in reported
    )


def test_what_is_no_finished_replay_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "track.csv").write_text("")
    assert main(["evaluate", str(tmp_path)]) == 1
    assert "summary.json: got No such file" in capsys.readouterr().err
    # a number beyond all, or none, cannot be written again as JSON
    odd = [f'{{"format": "groundstation-summary/1", "x": {number}}}' for number in ("1e999", "NaN", "-Infinity")]
    for text in ("{", "[]", '{"format": "other/1"}', *odd):
        (tmp_path / "summary.json").write_text(text)
        with pytest.raises(InputError, match=r"summary\.json"):
            load_summary(tmp_path / "summary.json")


def test_a_damaged_summary_is_refused_in_words(compared: Path, tmp_path: Path) -> None:
    """Expected: with one place taken out or spoilt it is compared, or refused by our own error."""
    whole = json.loads((compared / "runs" / "loose" / "summary.json").read_text(encoding="utf-8"))
    random = np.random.default_rng(5)
    (tmp_path / "track.csv").write_text("")
    refused: list[str] = []
    for _ in range(150):
        damaged = copy.deepcopy(whole)
        inside: Any = damaged
        while True:
            places = list(inside) if isinstance(inside, dict) else list(range(len(inside)))
            place = places[random.integers(len(places))]
            if not (isinstance(inside[place], dict | list) and inside[place]) or random.random() < 0.2:
                break
            inside = inside[place]
        if random.random() < 0.5:
            del inside[place]
        else:
            inside[place] = (None, "x", [], {}, -1, 1e308)[random.integers(6)]
        (tmp_path / "summary.json").write_text(json.dumps(damaged), encoding="utf-8")
        try:
            result = compare(CompareRequest(sources=(tmp_path,), work=tmp_path))
        except InputError as error:
            refused.append(str(error))
            continue
        assert format_comparison(result.runs, result.baseline)
        assert comparison_csv(result)
        assert comparison_json(result)
    assert len(refused) > 10
    assert all("summary.json" in reported for reported in refused)


def test_what_has_moved() -> None:
    moved = moved_figures({"a": 2.0, "gone": 1.0}, {"a": 2.2, "new": 0.0})
    assert moved["a"].percent == pytest.approx(10.0)
    assert moved["a"].within(0.11, 0.0)
    assert not moved["a"].within(0.09, 0.1)
    assert moved["a"].within(0.0, 0.21)
    assert not moved["gone"].within(1.0, 1.0)
    assert not moved["new"].within(1.0, 1.0)
    assert FigureChange(before=0.0, after=1.0).percent is None


def evo_ape() -> str:
    """Return evo's program; it is GPL and so lives in an environment of its own."""
    peers = ROOT / ".venv-peers" / "bin" / "evo_ape"
    program = os.environ.get("GROUNDSTATION_EVO_APE") or shutil.which("evo_ape") or str(peers)
    if not Path(program).is_file():
        absent("evo", "make peers, or set GROUNDSTATION_EVO_APE")
    return program


def test_evo_finds_our_rmse(compared: Path, tmp_path: Path) -> None:
    program = evo_ape()
    folder = compared / "runs" / "usual"
    home: Mapping[str, str] = {**os.environ, "HOME": str(tmp_path), "MPLBACKEND": "Agg", "PYTHONPATH": ""}
    command = [program, "tum", str(folder / "truth.tum"), str(folder / "track.tum"), "--t_max_diff", "0.0005"]
    command += ["--save_results", str(tmp_path / "ape.zip"), "--no_warnings"]
    done = subprocess.run(command, env=home, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr + done.stdout
    (line,) = [line for line in done.stdout.splitlines() if line.split()[:1] == ["rmse"]]
    ours = summary(folder)["accuracy"]["truth"]["total"]["ekf"]
    assert float(line.split()[1]) == pytest.approx(np.linalg.norm(ours["rmse_m"]), rel=EVO_TOLERANCE)
    # the sum of squares over the mean square is the number of pairs that evo has matched
    (total,) = [line for line in done.stdout.splitlines() if line.split()[:1] == ["sse"]]
    assert float(total.split()[1]) / float(line.split()[1]) ** 2 == pytest.approx(ours["epochs"], rel=1e-4)


def test_the_reference_trajectories_are_at_the_tracks_own_times(compared: Path) -> None:
    folder = compared / "runs" / "usual"
    track, truth = (np.loadtxt(folder / name) for name in ("track.tum", "truth.tum"))
    assert set(track[:, 0]) <= set(truth[:, 0])
    shared = np.isin(truth[:, 0], track[:, 0])
    rmse = np.sqrt(((track[:, 1:4] - truth[shared, 1:4]) ** 2).mean(axis=0))
    assert rmse == pytest.approx(summary(folder)["accuracy"]["truth"]["total"]["ekf"]["rmse_m"], rel=1e-4)
    with (folder / "track.csv").open() as file:
        assert sum(1 for row in csv.DictReader(file) if row["x_m"]) == len(track)
