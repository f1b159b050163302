"""Two of three cameras see a whole flight: what is known of the third is said."""

import csv
from pathlib import Path

import pytest

from groundstation.replay.replay import ReplayRequest, ReplayResult, replay
from groundstation.simulation import simulate
from groundstation.simulation.session_folder import write_session_folder
from tests.faulty_flight import drawn_path, scenario

pytestmark = pytest.mark.usefixtures("unrendered_figures")


def folder_of(folder: Path, lost_from_s: float) -> Path:
    """Three stations; of the first one of the rig there are pixels until a time, s."""
    session = folder / "session"
    write_session_folder(session, simulate(scenario(1, trajectory=drawn_path(1))), name="three")
    table = session / "detections.csv"
    head, *rows = table.read_text().splitlines()
    first = (session / "rig.toml").read_text().split('name = "')[1].split('"')[0]
    kept = [r for r in rows if not (f",{first}," in r and float(r.split(",")[0]) > lost_from_s)]
    table.write_text("\n".join([head, *kept]) + "\n")
    return session


def run(session: Path, out: Path, **how: object) -> ReplayResult:
    return replay(ReplayRequest(session=session, out=out, rerun=False, report=False, to_s=6.0, **how))


def test_rows_are_those_of_the_first_station_and_a_note_names_what_is_in_none(tmp_path: Path) -> None:
    """Expected: rows until the first station is lost, as the format has them, and a note on what the others saw."""
    result = run(folder_of(tmp_path, 3.0), tmp_path / "out")
    with (tmp_path / "out" / "track.csv").open() as file:
        rows = [(float(row["t_s"]), row["status"]) for row in csv.DictReader(file)]
    assert 2.8 < rows[-1][0] < 3.1
    notes = [n for n in result.evaluation.summary["faults"] if n.startswith("left: without a pixel 3.0 to 6.0 s")]
    assert len(notes) == 1


def test_a_station_of_which_nothing_came_is_named(tmp_path: Path) -> None:
    """Expected: a note of a folder, and of the recording of its replay."""
    result = run(folder_of(tmp_path, -1e9), tmp_path / "out", record=tmp_path / "flight.mcap")
    assert "left: no pixel in this part of detections.csv" in result.evaluation.summary["faults"]
    again = run(tmp_path / "flight.mcap", tmp_path / "again")
    wanted = "left: neither picture nor pixel in what was replayed of the recording"
    assert wanted in again.evaluation.summary["faults"]
