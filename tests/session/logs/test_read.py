"""Any log: recognised by content, refused in one line, placed in the session's frame; tables; damage at random."""

import builtins
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.errors import GroundstationError, LogError, MissingExtraError, SessionError
from groundstation.geometry.geodesy import ecef_from_enu, ecef_from_geodetic, enu_from_geodetic, geodetic_from_ecef
from groundstation.session.logs.fixes import LogOptions
from groundstation.session.logs.gps_time import gps_from_text
from groundstation.session.logs.placement import place_log
from groundstation.session.logs.read import GnssLog, read_log, rising
from tests.complaints import complaint, only
from tests.session.logs.damage import damaged, forged, seeds
from tests.session.logs.writers import dataflash, flight, nmea_log, tlog, ubx_log, ulog

DATA = Path(__file__).parent / "data"
HEAD = "utc,lat_deg,lon_deg,height_m\n"
ROW = "2025-05-08T11:59:52Z,35.681,139.7605,75.01\n"


def table(folder: Path, text: str, options: LogOptions | None = None) -> GnssLog:
    path = folder / "log.csv"
    path.write_text(text)
    return read_log(path, options)


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("utc,lat_deg,lon_deg,height_m", ROW),
        ("Time UTC,Latitude (deg),Longitude [deg],Height (m)", ROW),
        ("unix_s,lat_e7,lng_e7,alt_ellipsoid_mm", "1746705592,356810000,1397605000,75010\n"),
        (
            "gps_week,gps_tow_s,lat_rad,lon_rad,alt_msl_m,undulation_m",
            "2365,388810,0.62275093,2.43928089,37.284,37.726\n",
        ),
        ("unix_s,latitude_deg,long_deg,ellipsoid_height_ft", "1746705592.0,35.681,139.7605,246.0958\n"),
    ],
)
def test_tables_by_name_and_unit(tmp_path: Path, header: str, row: str) -> None:
    log = table(tmp_path, header + "\n" + row)
    assert log.gps_s[0] == gps_from_text("2025-05-08T11:59:52Z")
    assert (log.lat_deg[0], log.lon_deg[0], log.height_m[0]) == pytest.approx((35.681, 139.7605, 75.01), abs=1e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("utc,lat,lon_deg,height_m\n" + ROW, "log.csv: line 1: got 'lat', without a unit; wanted lat_deg or lat_e7"),
        ("utc,lat_deg,height_m\n", "line 1: got no column of lon; wanted lon_deg"),
        ("lat_deg,lon_deg,height_m\n", "line 1: got no column of time; wanted utc"),
        ("utc,lat_deg,lon_deg\n", "line 1: got no column of height"),
        ("utc,lat_deg,lon_deg,alt_m\n" + ROW, "line 1: got an altitude without a reference surface"),
        ("utc,lat_deg,lon_deg,alt_msl_m\n" + ROW, "got heights above sea level, and no geoid separation"),
        (HEAD + "noon,1,2,3\n", "line 2: got utc = 'noon'; wanted a time such as"),
        (HEAD + ROW.replace("35.681", "95"), "line 2: got a latitude of 95; wanted at most 90"),
        (HEAD + ROW.replace("35.681", "x"), "line 2: got lat_deg = 'x'; wanted a finite number"),
        (HEAD, "log.csv: got no usable position (nothing in it)"),
    ],
)
def test_tables_that_leave_something_open(tmp_path: Path, text: str, message: str) -> None:
    assert message in complaint(SessionError, lambda: table(tmp_path, text))


def test_a_bare_altitude_is_settled_by_a_word(tmp_path: Path) -> None:
    text = "utc,lat_deg,lon_deg,alt_m\n" + ROW
    assert table(tmp_path, text, LogOptions(height="ellipsoid")).height_m[0] == 75.01
    sea = table(tmp_path, text, LogOptions(height="sea level", geoid_separation_m=37.7))
    assert sea.height_m[0] == pytest.approx(112.71)


def test_a_log_is_recognised_by_its_content_not_by_its_name(tmp_path: Path) -> None:
    same = {"a.log": nmea_log(flight()), "b.bin": ubx_log(flight()), "c.dat": ulog(flight()), "d": dataflash(flight())}
    for name, content in same.items():
        (tmp_path / name).write_bytes(content)
        assert len(read_log(tmp_path / name, LogOptions(geoid_separation_m=37.726)).gps_s) == 6


def test_what_is_no_log(tmp_path: Path) -> None:
    assert "got no such file" in complaint(LogError, lambda: read_log(tmp_path / "none.pos"))
    assert "got a folder" in complaint(LogError, lambda: read_log(tmp_path))
    (tmp_path / "picture.jpg").write_bytes(b"\xff\xd8\xff")
    assert "got a log of no format that is known" in complaint(LogError, lambda: read_log(tmp_path / "picture.jpg"))
    for suffix in (".nmea", ".pos", ".ulg", ".bin", ".tlog", ".ubx"):
        (tmp_path / f"empty{suffix}").write_bytes(b"")
        assert complaint(LogError, lambda s=suffix: read_log(tmp_path / f"empty{s}")).startswith(
            f"empty{suffix}: got no"
        )


def test_a_log_before_2000_needs_its_date(tmp_path: Path) -> None:
    reported = complaint(LogError, lambda: table(tmp_path, HEAD + ROW.replace("2025", "1985")))
    assert "got a log of 1985-05-08; wanted its true date" in reported


@pytest.mark.parametrize(
    ("name", "content", "package"),
    [
        ("a.nmea", nmea_log(flight(1)), "pynmeagps"),
        ("a.ubx", ubx_log(flight(1)), "pyubx2"),
        ("a.ulg", ulog(flight(1)), "pyulog"),
        ("a.bin", dataflash(flight(1)), "pymavlink"),
        ("a.tlog", tlog(flight(1)), "pymavlink"),
    ],
)
def test_a_missing_package_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: bytes, package: str
) -> None:
    imports = builtins.__import__

    def without(wanted: str, *rest: object, **more: object) -> object:
        if wanted.split(".")[0] == package:
            raise ImportError(wanted)
        return imports(wanted, *rest, **more)  # type: ignore[arg-type]

    (tmp_path / name).write_bytes(content)
    monkeypatch.setattr(builtins, "__import__", without)
    reported = complaint(MissingExtraError, lambda: read_log(tmp_path / name))
    assert reported.endswith("pip install 'groundstation[logs]'")


def test_placed_in_the_runways_frame_with_turned_sigmas() -> None:
    log = read_log(DATA / "calendar.pos")
    origin = (35.68, 139.76, 60.0)
    enu = place_log(log, origin, 0.0, float(log.gps_s[0]))
    baseline = [float(v) for v in (DATA / "enu.pos").read_text().splitlines()[10].split()[2:5]]
    # RTKLIB's own east, north, up of the same fix
    assert enu[0].position_runway_m == pytest.approx(baseline, abs=2e-3)
    assert enu[0].t_s == 0.0
    assert enu[0].status == "fix"
    west = place_log(log, origin, 270.0, float(log.gps_s[0]))
    # +y points west: x is north
    assert west[0].position_runway_m == pytest.approx([baseline[1], -baseline[0], baseline[2]], abs=2e-3)
    assert west[0].sigma_m == pytest.approx([0.0088, 0.0075, 0.0272], abs=1e-6)
    reported = complaint(LogError, lambda: place_log(log, (47.0, 8.0, 0.0), 0.0, 0.0))
    assert "km and more from the origin; wanted some within 50 km, or another origin" in reported
    exchanged = complaint(LogError, lambda: place_log(log, (139.76, 35.68, 60.0), 0.0, 0.0))
    assert "from the origin, near the one with latitude and longitude exchanged; wanted some within 50 km" in exchanged


@given(st.floats(-90, 90), st.floats(-179.9, 179.9), st.floats(-500, 50_000))
def test_places_there_and_back(lat: float, lon: float, height: float) -> None:
    ecef = ecef_from_geodetic(np.array(lat), np.array(lon), np.array(height))
    back = geodetic_from_ecef(ecef)
    again = ecef_from_geodetic(back[0], back[1], back[2])
    assert np.linalg.norm(again - ecef) < 1e-6
    assert float(back[2]) == pytest.approx(height, abs=1e-6)
    enu = np.array([120.0, -40.0, 9.0])
    there = geodetic_from_ecef(ecef_from_enu(enu, (lat, lon, height)))
    near = enu_from_geodetic(there[0], there[1], there[2], (lat, lon, height))
    assert near == pytest.approx(enu, abs=1e-6)


@given(st.lists(st.integers(0, 12).map(float), max_size=30))
def test_the_longest_choice_of_rising_times(times: list[float]) -> None:
    chosen = rising(np.array(times))
    kept = [times[k] for k in chosen]
    assert chosen == sorted(set(chosen))
    assert kept == sorted(set(kept))
    # by trying all: the longest that ends at each
    best = [1] * len(times)
    for k in range(len(times)):
        best[k] = 1 + max((best[j] for j in range(k) if times[j] < times[k]), default=0)
    assert len(chosen) == max(best, default=0)


@given(name=st.sampled_from(sorted(seeds())), seed=st.integers(0, 2**32), forge=st.booleans())
def test_arbitrary_damage_raises_only_project_errors(
    tmp_path_factory: pytest.TempPathFactory, name: str, seed: int, forge: bool
) -> None:
    chance = random.Random(seed)
    content = seeds()[name]
    path = tmp_path_factory.getbasetemp() / f"damaged{Path(name).suffix}"
    path.write_bytes(forged(name, content, chance) if forge else damaged(content, chance))
    with only(GroundstationError):
        log = read_log(path, LogOptions(geoid_separation_m=37.7, base_deg_m=(35.68, 139.76, 60.0)))
        assert np.all(np.diff(log.gps_s) > 0)
        assert np.all(np.isfinite([log.lat_deg, log.lon_deg, log.height_m, *log.sigma_enu_m.T]))
        assert np.all(log.sigma_enu_m > 0)
