"""An autopilot's log: read into a local frame, refused with file and line."""

from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import SessionError
from groundstation.session.flight_log import load_flight_log
from tests.complaints import complaint

ROWS = [
    "timestamp,Lat,Lng,Alt,Spd",
    "100.0,51.64,-2.52,10.0,1",
    "100.2,51.6401,-2.52,11.0,1",
    "100.4,51.64,-2.5199,9,1",
]


def write(folder: Path, rows: list[str]) -> Path:
    path = folder / "log.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_places_are_east_north_up_of_the_first_row(tmp_path: Path) -> None:
    log = load_flight_log(write(tmp_path, ROWS))
    assert log.t_s == pytest.approx([0.0, 0.2, 0.4])
    assert log.position_enu_m == pytest.approx(np.array([[0, 0, 0], [0, 11.13, 1], [6.92, 0, -1]]), abs=0.01)
    assert log.origin_deg_m == (51.64, -2.52, 10.0)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["timestamp,Lat,Lng"], "log.csv: line 1: got timestamp, Lat, Lng; wanted a column Alt"),
        (ROWS[:2], "log.csv: line 1: got 1 rows below it; wanted two or more"),
        ([*ROWS, "100.4,51.64,-2.52,9,1"], "log.csv: line 5: got timestamp = 100.4, the same time"),
        ([*ROWS, "100.5,91.64,-2.52,9,1"], "log.csv: line 5: got Lat = 91.64; wanted at most 90"),
        ([*ROWS, "100.5,51.64,nan,9,1"], "log.csv: line 5: got Lng = 'nan'"),
        ([*ROWS, "100.5,0,0,9,1"], "log.csv: line 5: got a place 5536 km from the first row's; wanted at most 50 km"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path: Path, rows: list[str], message: str) -> None:
    reported = complaint(SessionError, lambda: load_flight_log(write(tmp_path, rows)))
    assert message in reported


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert "no such file" in complaint(SessionError, lambda: load_flight_log(tmp_path / "none.csv"))
