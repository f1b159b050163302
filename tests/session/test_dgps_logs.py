"""A log in the session folder, read as it is: frame, clock, options."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import LogError, SessionError
from groundstation.session import Session, load_dgps, load_session
from tests.complaints import complaint
from tests.session.folder import Tiny
from tests.session.logs.writers import dataflash, flight, nmea_log, tlog, ubx_log, ulog

DATA = Path(__file__).parent / "logs" / "data"
ORIGIN = "[origin]\nlat_deg = 35.68\nlon_deg = 139.76\nheight_m = 60.0\ny_axis_azimuth_deg = 0\n"
DGPS = "[dgps]\nepoch_utc = 2025-05-08T11:59:50Z\ngeoid_separation_m = 37.726\n"


def session(folder: Path, text: str) -> Session:
    return load_session(Tiny(video="png", rows=1, session=text).write(folder))


def test_rtklibs_east_north_up_agrees(tmp_path: Path) -> None:
    folder = session(tmp_path, ORIGIN + DGPS)
    shutil.copy(DATA / "calendar.pos", tmp_path / "dgps.pos")
    fixes = load_dgps(folder)
    rows = [r.split() for r in (DATA / "enu.pos").read_text().splitlines() if not r.startswith("%")]
    assert np.array([f.position_runway_m for f in fixes]) == pytest.approx(
        np.array([[float(v) for v in r[2:5]] for r in rows]), abs=2e-3
    )
    assert [f.t_s for f in fixes] == pytest.approx(2.0 + 0.2 * np.arange(12), abs=1e-6)
    assert {f.status for f in fixes} == {"fix"}


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("dgps.nmea", nmea_log(flight())),
        ("dgps.ulg", ulog(flight())),
        ("dgps.bin", dataflash(flight())),
        ("dgps.tlog", tlog(flight())),
        ("dgps.ubx", ubx_log(flight())),
        ("dgps.csv", b"utc,lat_deg,lon_deg,height_m\n2025-05-08T11:59:52Z,35.681,139.7605,75.01\n"),
    ],
)
def test_every_format_by_its_name(tmp_path: Path, name: str, content: bytes) -> None:
    folder = session(tmp_path, ORIGIN + DGPS)
    (tmp_path / name).write_bytes(content)
    notes: list[str] = []
    fix = load_dgps(folder, on_note=notes.append)[0]
    assert fix.t_s == pytest.approx(2.0, abs=1e-3)
    assert fix.position_runway_m == pytest.approx([45.26, 110.95, 15.01], abs=0.02)
    assert all(note.startswith(f"{name}: ") for note in notes)


def test_without_an_epoch_midnight_is_zero_and_reported(tmp_path: Path) -> None:
    folder = session(tmp_path, ORIGIN + "[clocks]\ndgps = { offset_s = -43190.0 }\n")
    shutil.copy(DATA / "calendar.pos", tmp_path / "dgps.pos")
    notes: list[str] = []
    assert load_dgps(folder, on_note=notes.append)[0].t_s == pytest.approx(2.0, abs=1e-6)
    assert notes == ["dgps.pos: t_s counts from 2025-05-08T00:00:00Z; epoch_utc in [dgps] would change that"]


def test_missing_information_of_a_log_is_requested(tmp_path: Path) -> None:
    folder = session(tmp_path / "none", "")
    shutil.copy(DATA / "calendar.pos", tmp_path / "none" / "dgps.pos")
    reported = complaint(SessionError, lambda: load_dgps(folder))
    assert reported.startswith("dgps.pos: got latitudes and longitudes without an origin; wanted [origin]")
    faults: list[SessionError] = []
    assert load_dgps(folder, faults.append) == ()
    assert len(faults) == 1
    (tmp_path / "none" / "dgps.ubx").write_bytes(b"")
    assert "got dgps.pos and dgps.ubx; wanted one log" in complaint(SessionError, lambda: load_dgps(folder))
    far = session(tmp_path / "far", ORIGIN.replace("35.68", "45.68") + DGPS)
    shutil.copy(DATA / "calendar.pos", tmp_path / "far" / "dgps.pos")
    assert "km and more from the origin" in complaint(LogError, lambda: load_dgps(far))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("epoch = 1", "dgps: epoch: got an unknown key"),
        ("epoch_utc = 'noon'", "dgps: epoch_utc: got 'noon'; wanted a time such as"),
        ("epoch_utc = 1970-01-01T00:00:00Z", "wanted a time such as 2026-05-17T09:30:00Z, of 1981 or later"),
        ("date = 7", "dgps: date: got '7'; wanted a date such as 2026-05-17"),
        ("height = 'msl'", "dgps: height: got 'msl'; wanted one of 'ellipsoid', 'sea level'"),
        ("geoid_separation_m = 999", "got 999; wanted a finite number ≥ -200 ≤ 200"),
        ("base = [95, 0, 0]", "dgps: base: got [95.0, 0.0, 0.0]; wanted latitude and longitude in degrees"),
        ("instance = 0.5", "dgps: instance: got 0.5; wanted a whole number"),
    ],
)
def test_an_impossible_dgps_table(tmp_path: Path, line: str, message: str) -> None:
    assert message in complaint(SessionError, lambda: session(tmp_path, f"[dgps]\n{line}\n"))
