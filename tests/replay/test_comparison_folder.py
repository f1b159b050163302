"""`evaluate --out`: the folder has tables, page, pictures and maps of whatever the runs have, and says what lacks."""

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.replay.compare import COMPARISON_FILES
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.simulation import case_b, simulate
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.session_folder import write_session_folder

pytestmark = pytest.mark.usefixtures("unrendered_figures")

ORIGIN = "\n[origin]\nlat_deg = 47.3977\nlon_deg = 8.5456\nheight_m = 455.2\ny_axis_azimuth_deg = 271.5\n"
ALWAYS = {"comparison.html", "table.md", "comparison.csv", "comparison.json"}
MAPS = {"tracks.kml", "tracks.geojson"}
Changed = Callable[[dict[str, Any], Path], None]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short flight with exact truth, whose place on Earth is stated."""
    folder = tmp_path_factory.mktemp("sessions") / "glide"
    flight = simulate(case_b(seed=5, trajectory=GlideApproach(start_y_m=200.0, end_y_m=120.0)))
    write_session_folder(folder, flight, name="glide")
    lines = (folder / "session.toml").read_text().splitlines()
    # where the recording comes from, in words, has the same key
    kept = [line for line in lines if not line.startswith("origin =")]
    (folder / "session.toml").write_text("\n".join(kept) + ORIGIN)
    return folder


@pytest.fixture(scope="module")
def first(session: Path) -> Path:
    out = session.parents[1] / "runs" / "first"
    replay(ReplayRequest(session=session, out=out, rerun=False, report=False))
    return out


@pytest.fixture
def changed(first: Path, tmp_path: Path) -> Callable[[str, Changed], Path]:
    """Return a copy of the run, of another name, with its summary or its files changed."""

    def copy(name: str, change: Changed) -> Path:
        folder = tmp_path / name
        shutil.copytree(first, folder)
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        change(summary, folder)
        (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
        return folder

    return copy


def evaluate(out: Path, *sources: Path) -> set[str]:
    """Evaluate into a folder and return the names of what is in it."""
    assert main(["evaluate", *map(str, sources), "--out", str(out)]) == 0
    assert not list(out.rglob("*.part"))
    return {path.name for path in out.iterdir()}


def shifted(summary: dict[str, Any], folder: Path) -> None:
    """Move the track 1 m along x, in the summary, too."""
    rows = _rows(folder / "track.csv")
    for row in rows:
        row["x_m"] = str(float(row["x_m"]) + 1.0) if row["x_m"] else ""
    _write(folder / "track.csv", rows)
    ekf = summary["accuracy"]["truth"]["total"]["ekf"]
    ekf["rmse_m"][0] = float(np.sqrt(ekf["rmse_m"][0] ** 2 + 1.0 + 2.0 * ekf["mean_m"][0]))


def later(summary: dict[str, Any], folder: Path) -> None:
    """Move the whole run by 1000 s."""
    rows = _rows(folder / "track.csv")
    _write(folder / "track.csv", [{**row, "t_s": f"{float(row['t_s']) + 1000.0:.6f}"} for row in rows])
    lines = [line.split(" ", 1) for line in (folder / "truth.tum").read_text().splitlines()]
    (folder / "truth.tum").write_text("\n".join(f"{float(t) + 1000.0:.6f} {rest}" for t, rest in lines) + "\n")
    summary["session"]["from_s"] += 1000.0
    summary["session"]["to_s"] += 1000.0


def lost(summary: dict[str, Any], folder: Path) -> None:
    """Remove the track."""
    rows = _rows(folder / "track.csv")
    empty = dict.fromkeys(rows[0], "")
    _write(folder / "track.csv", [{**empty, "t_s": row["t_s"], "status": "searching"} for row in rows])
    summary["no_track"] = "no candidate of two cameras was confirmed"
    summary["accuracy"] = {}


def untracked(summary: dict[str, Any], folder: Path) -> None:
    """Remove the track, with the words that a replay has for it."""
    lost(summary, folder)
    summary["no_track"] = "no track: in none of 40 pairs did two cameras show a moving target at places that agree"


def unreferenced(summary: dict[str, Any], folder: Path) -> None:
    """Remove the reference."""
    (folder / "truth.tum").unlink()
    summary["accuracy"] = {}


def nowhere(summary: dict[str, Any], folder: Path) -> None:
    """Remove the origin."""
    summary["place"]["origin"] = None


def _rows(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text().splitlines()))


def _write(path: Path, rows: list[dict[str, str]]) -> None:
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def plots(out: Path) -> set[str]:
    return {path.stem for path in (out / "plots").glob("*.svg")}


def test_a_replay_writes_its_track_on_a_map(first: Path) -> None:
    whole = json.loads((first / "track.geojson").read_text(encoding="utf-8"))
    kinds = {f["properties"]["kind"] for f in whole["features"]}
    assert kinds == {"track", "truth", "station"}
    assert ElementTree.parse(first / "track.kml").getroot().tag.endswith("kml")
    place = json.loads((first / "summary.json").read_text(encoding="utf-8"))["place"]
    assert place["origin"]["height_m"] == 455.2
    assert set(place["stations_m"]) == {"left", "right"}


def test_one_run_and_several_give_the_same_files(
    first: Path, changed: Callable[[str, Changed], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert evaluate(tmp_path / "one", first) == ALWAYS | MAPS | {"plots"}
    printed = capsys.readouterr().out
    for name in ALWAYS | MAPS | {"plots"}:
        assert f"wrote {tmp_path / 'one' / name}" in printed
    second = changed("shifted", shifted)
    assert evaluate(tmp_path / "two", first, second) == ALWAYS | MAPS | {"plots"}
    stems = {f"{kind}_truth" for kind in ("errors", "distribution", "boxes", "range", "nees")}
    assert plots(tmp_path / "one") == plots(tmp_path / "two") == stems | {"tracks_above", "tracks_side"}
    whole = json.loads((tmp_path / "two" / "tracks.geojson").read_text(encoding="utf-8"))
    assert {f["properties"].get("run") for f in whole["features"]} == {"first", "shifted", None}
    # every file of the comparison is declared, so that it cannot replace an input
    assert set(COMPARISON_FILES) == ALWAYS | MAPS


def test_the_tables_have_the_errors_of_the_tracks(
    first: Path, changed: Callable[[str, Changed], Path], tmp_path: Path
) -> None:
    """Expected: the size of the error, recomputed from the tables, is the summary's; 1 m to the side adds up."""
    evaluate(tmp_path / "out", first, changed("shifted", shifted))
    lines = (tmp_path / "out" / "table.md").read_text(encoding="utf-8").splitlines()
    start = lines.index("### Size of the EKF's error against the truth, in 3-D")
    rows = {line.split()[1]: line.split(" | ")[2] for line in lines[start + 4 : start + 6]}
    rmse = json.loads((first / "summary.json").read_text())["accuracy"]["truth"]["total"]["ekf"]
    assert float(rows["first"]) == pytest.approx(np.linalg.norm(rmse["rmse_m"]), abs=6e-4)
    mean_x = rmse["mean_m"][0]
    moved = np.sqrt(np.linalg.norm(rmse["rmse_m"]) ** 2 + 1.0 + 2.0 * mean_x)
    assert float(rows["shifted"]) == pytest.approx(moved, abs=6e-4)
    # whole pipe tables: each row has as many cells as its head
    for number, line in enumerate(lines):
        if line.startswith("| :--"):
            head = lines[number - 1].count("|")
            assert head == line.count("|") == lines[number + 1].count("|") == lines[number + 2].count("|")
    page = (tmp_path / "out" / "comparison.html").read_text(encoding="utf-8")
    assert "Smallest error in 3-D against the truth: first, RMSE" in page


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (later, "the runs have no time in common"),
        (lost, "other: no track: no candidate of two cameras was confirmed"),
        (untracked, "other: no track: in none of 40 pairs did two cameras"),
        (unreferenced, "other: no reference that its track can be compared with"),
        (nowhere, "other: not in tracks.kml and tracks.geojson: its place on Earth is unknown; lat_deg, lon_deg"),
    ],
)
def test_what_one_run_lacks_is_said_and_the_rest_is_written(
    first: Path,
    changed: Callable[[str, Changed], Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Changed,
    reason: str,
) -> None:
    names = evaluate(tmp_path / "out", first, changed("other", change))
    assert names == ALWAYS | MAPS | {"plots"}
    reported = capsys.readouterr().err
    assert f"note: {reason}" in reported
    for file in ("table.md", "comparison.html"):
        assert reason.split(";")[0] in (tmp_path / "out" / file).read_text(encoding="utf-8")
    assert "errors_truth" in plots(tmp_path / "out")


def test_runs_with_nothing_but_a_summary_still_give_the_tables(
    changed: Callable[[str, Changed], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: tables and page without pictures and maps; maps and pictures of an earlier comparison are removed."""
    whole = changed("whole", lambda summary, folder: None)
    assert evaluate(tmp_path / "out", whole) == ALWAYS | MAPS | {"plots"}
    capsys.readouterr()

    def bare(summary: dict[str, Any], folder: Path) -> None:
        lost(summary, folder)
        nowhere(summary, folder)

    names = evaluate(tmp_path / "out", changed("bare", bare))
    assert names == ALWAYS | {"plots"}
    assert plots(tmp_path / "out") == set()
    page = (tmp_path / "out" / "comparison.html").read_text(encoding="utf-8")
    assert "No run has errors" in page
    assert "<svg" not in page
    reported = capsys.readouterr().err
    (line,) = [line for line in reported.splitlines() if "tracks.kml" in line]
    assert line == (
        "note: bare: no tracks.kml and tracks.geojson: its place on Earth is unknown; lat_deg, lon_deg, height_m and "
        "y_axis_azimuth_deg in [origin] of session.toml (instead of a sentence origin there) would state it"
    )


def test_a_table_that_cannot_be_read_leaves_its_run_out_of_the_pictures(
    first: Path, changed: Callable[[str, Changed], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def damage(summary: dict[str, Any], folder: Path) -> None:
        text = (folder / "track.csv").read_text()
        (folder / "track.csv").write_text(text.replace("tracking", "landed", 1))

    names = evaluate(tmp_path / "out", first, changed("damaged", damage))
    assert names == ALWAYS | MAPS | {"plots"}
    assert "note: damaged: not in the pictures: track.csv: line" in capsys.readouterr().err
    assert "damaged" in (tmp_path / "out" / "table.md").read_text(encoding="utf-8")
    assert "damaged" not in (tmp_path / "out" / "tracks.geojson").read_text(encoding="utf-8")


def test_an_input_is_not_overwritten(first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path.name: path.read_bytes() for path in first.iterdir() if path.is_file()}
    assert main(["evaluate", str(first), "--out", str(first)]) == 1
    assert f"{first}: got a folder that is read; wanted another --out" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in first.iterdir() if path.is_file()} == before
    # next to its parent's other files is a place for it
    assert evaluate(first.parent, first) >= ALWAYS | MAPS | {"first"}
    assert main(["evaluate", str(first), "--baseline", str(first), "--out", str(first)]) == 1


def test_without_a_folder_nothing_is_written(
    first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["evaluate", str(first)]) == 0
    assert list(tmp_path.iterdir()) == []
    assert "wrote" not in capsys.readouterr().out


def test_a_folder_that_cannot_be_made_is_reported_before_a_replay(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["evaluate", str(session), "--out", str(tmp_path / "file" / "out")]) == 1
    assert "wanted a folder that can be written" in capsys.readouterr().err
