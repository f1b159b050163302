"""RTKLIB's solution files: those that RTKLIB wrote, in all variants, and rows that were damaged."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.errors import LogError
from groundstation.session.logs.fixes import FixQuality, LogOptions
from groundstation.session.logs.gps_time import gps_from_text
from groundstation.session.logs.read import GnssLog, read_log
from tests.complaints import complaint

DATA = Path(__file__).parent / "data"
FIRST = gps_from_text("2025-05-08T11:59:52Z")
LAT, LON, HEIGHT = 35.680999993, 139.760500004, 75.0100
VARIANTS = [
    "week_tow",
    "calendar",
    "utc",
    "utc_tow",
    "jst",
    "dms",
    "dms_comma",
    "ecef",
    "enu",
    "enu_no_ref",
    "comma",
    "tab",
    "velocity",
    "no_header",
    "no_header_ecef",
]


def same_flight(log: GnssLog) -> None:
    assert len(log.gps_s) == 12
    assert log.gps_s[0] == pytest.approx(FIRST, abs=1e-6)
    assert np.diff(log.gps_s) == pytest.approx(np.full(11, 0.2), abs=1e-6)
    assert (log.lat_deg[0], log.lon_deg[0]) == pytest.approx((LAT, LON), abs=3e-9)
    # heights of other frames come back within their own last digit
    assert log.height_m[0] == pytest.approx(HEIGHT, abs=2e-4)
    assert log.quality[0] is FixQuality.FIX
    assert log.sigma_enu_m[0] == pytest.approx([0.0075, 0.0088, 0.0272], abs=2e-4)
    assert log.covariance_en_m2[0] == pytest.approx(-(0.0032**2), abs=3e-6)


@pytest.mark.parametrize("name", VARIANTS)
def test_what_rtklib_wrote_is_one_flight_in_all_its_variants(name: str) -> None:
    log = read_log(DATA / f"{name}.pos")
    same_flight(log)
    assert log.remarks == ()


def test_sigmas_beyond_reckoning_are_none(tmp_path: Path) -> None:
    """Expected: the place stays, its sigma is that of its quality, and nothing overflows on the way."""
    text = (DATA / "ecef.pos").read_text()
    path = tmp_path / "ecef.pos"
    path.write_text(text.replace("0.0216   0.0119   0.0163", "9" * 200 + "   0.0119   0.0163", 1))
    before, after = read_log(DATA / "ecef.pos"), read_log(path)
    np.testing.assert_array_equal(after.lat_deg, before.lat_deg)
    changed = np.any(after.sigma_enu_m != before.sigma_enu_m, axis=1)
    assert changed.sum() == 1
    assert after.sigma_enu_m[changed].max() < 0.1


def test_heights_above_the_geoid_need_its_separation() -> None:
    reported = complaint(LogError, lambda: read_log(DATA / "geodetic.pos"))
    assert reported == (
        "geodetic.pos: got heights above sea level, and no geoid separation; "
        "wanted geoid_separation_m in [dgps] of session.toml, or --geoid-separation"
    )
    same_flight(read_log(DATA / "geodetic.pos", LogOptions(geoid_separation_m=37.7255)))


def test_a_single_point_solution_is_recognised() -> None:
    log = read_log(DATA / "single.pos")
    assert set(log.quality) == {FixQuality.SINGLE}
    assert log.sigma_enu_m[0] == pytest.approx([6.0540, 7.1121, 19.7774])


@pytest.mark.parametrize("name", ["calendar", "week_tow", "comma", "ecef", "velocity", "dms"])
def test_without_any_header_the_defaults_are_used_and_reported(tmp_path: Path, name: str) -> None:
    rows = [r for r in (DATA / f"{name}.pos").read_text().splitlines(keepends=True) if not r.startswith("%")]
    path = tmp_path / "bare.pos"
    path.write_text("".join(rows))
    log = read_log(path)
    same_flight(log)
    assert any("no header: taken as GPS time" in r for r in log.remarks)


def write(folder: Path, edit: dict[int, str], source: str = "calendar", end: str = "\n") -> Path:
    """Change lines of a file, counted from the first row."""
    lines = (DATA / f"{source}.pos").read_text().splitlines()
    first = next(k for k, line in enumerate(lines) if not line.startswith("%"))
    for k, new in edit.items():
        lines[first + k] = new
    path = folder / "log.pos"
    path.write_text("\n".join(lines) + end)
    return path


ROW = "2025/05/08 12:00:10.200   35.681001993  139.760499003    75.3096   1   7   0.0088   0.0075   0.0272  -0.0032"
ROW += "   0.0121  -0.0063   0.00   80.2"


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        (ROW[:60], "row cut short"),
        (ROW[:-1].rsplit(None, 1)[0], "row cut short"),
        (ROW + " 1", "row with too many numbers"),
        (ROW.replace("35.681001993", "35.68x001993"), "row with a cell that is no number"),
        (ROW.replace("35.681001993", "nan"), "row with a cell that is no number"),
        (ROW.replace("35.681001993", "95.681001993"), "row that is no place on Earth"),
        (ROW.replace("12:00:10", "12:60:10"), "row without a time"),
        (ROW.replace("05/08", "02/30"), "row without a time"),
        (ROW.replace("   1   7", "   0   7"), "row without a solution (Q)"),
        (ROW.replace("   1   7", "   9   7"), "row with an unknown Q"),
        (ROW.replace("35.681001993", "36.681001993"), "position far from all others"),
        (ROW.replace("12:00:10.200", "13:00:10.200"), "position whose time does not grow"),
        ("\x00\xff\xfe", "row cut short"),
        ("1" * 5000, "line of more than 4096 bytes"),
    ],
)
def test_a_damaged_row_is_counted_and_costs_no_other(tmp_path: Path, row: str, reason: str) -> None:
    log = read_log(write(tmp_path, {1: row}))
    assert len(log.gps_s) == 11
    assert log.remarks[0].startswith(f"log.pos: left out 1 × {reason} (first: ")
    assert log.lat_deg == pytest.approx(np.full(11, LAT), abs=1e-4)


def test_an_empty_cell_is_not_filled_with_its_neighbour(tmp_path: Path) -> None:
    row = "2025/05/08 12:00:10.200,, 139.760499003, 75.3096, 1, 7, 0.0088, 0.0075, 0.0272,-0.0032, 0.0121,-0.0063,0,8"
    log = read_log(write(tmp_path, {1: row}, "comma"))
    assert "1 × row with a cell that is no number" in log.remarks[0]


def test_a_last_line_without_its_end(tmp_path: Path) -> None:
    assert len(read_log(write(tmp_path, {11: ROW.replace(":10.2", ":12.2")}, end="")).gps_s) == 12
    assert len(read_log(write(tmp_path, {11: ROW[:50]}, end="")).gps_s) == 11


def test_the_sign_of_zero_degrees_counts(tmp_path: Path) -> None:
    text = (DATA / "dms.pos").read_text().replace("  35 40 ", "  -0 40 ")
    (tmp_path / "south.pos").write_text(text)
    assert read_log(tmp_path / "south.pos").lat_deg[0] == pytest.approx(-(LAT - 35.0), abs=3e-9)


def test_a_baseline_from_nowhere(tmp_path: Path) -> None:
    text = "".join(r for r in (DATA / "enu.pos").read_text().splitlines(keepends=True) if "ref pos" not in r)
    path = tmp_path / "enu.pos"
    path.write_text(text)
    reported = complaint(LogError, lambda: read_log(path))
    assert "got a baseline from a base at an unknown place; wanted a '% ref pos' line" in reported
    same_flight(read_log(path, LogOptions(base_deg_m=(35.68, 139.76, 60.0))))


@pytest.mark.parametrize(("name", "number"), [("enu.pos", "45.1730"), ("ecef.pos", "-3959336.5478")])
def test_a_place_beyond_the_earth_costs_its_row_only(tmp_path: Path, name: str, number: str) -> None:
    text = (DATA / name).read_text().replace(number, "9" * 308)
    assert text.count("9" * 308) == 1
    (tmp_path / "far.pos").write_text(text)
    with np.errstate(all="raise"):
        log = read_log(tmp_path / "far.pos")
    assert len(log.gps_s) == 11
    assert "1 × row that is no place on Earth" in log.remarks[0]


def test_a_header_with_a_second_kind_of_place_is_read_by_the_first(tmp_path: Path) -> None:
    """Expected: the baseline that the header begins with, though a later column is named latitude."""
    text = (DATA / "enu.pos").read_text()
    assert text.count("sdnu(m)") == 1
    (tmp_path / "two.pos").write_text(text.replace("sdnu(m)", "latitude(deg)"))
    same_flight(read_log(tmp_path / "two.pos"))


def test_another_datum_and_other_columns(tmp_path: Path) -> None:
    text = (DATA / "calendar.pos").read_text()
    path = tmp_path / "log.pos"
    path.write_text(text.replace("=WGS84/", "=Tokyo/"))
    assert "got the datum Tokyo; wanted WGS84" in complaint(LogError, lambda: read_log(path))
    path.write_text(text.replace("latitude(deg)", "northing(m)"))
    assert "got columns northing longitude height" in complaint(LogError, lambda: read_log(path))
    path.write_text(text.replace("height(m)", "height(ft)"))
    assert "got height in (ft)" in complaint(LogError, lambda: read_log(path))


@given(
    lat=st.floats(-89.9, 89.9),
    lon=st.floats(-180, 180),
    height=st.floats(-400, 9000),
    second=st.integers(0, 604_799_000),
    week=st.integers(1100, 3000),
    quality=st.integers(1, 6),
    separator=st.sampled_from([" ", ",", "\t", ";"]),
    calendar=st.booleans(),
)
def test_rows_as_printed_by_rtklib_are_read_back(
    tmp_path_factory: pytest.TempPathFactory,
    lat: float,
    lon: float,
    height: float,
    second: int,
    week: int,
    quality: int,
    separator: str,
    calendar: bool,
) -> None:
    import datetime

    moment = datetime.datetime(1980, 1, 6) + datetime.timedelta(weeks=week, milliseconds=second)
    time = (
        f"{moment:%Y/%m/%d %H:%M:%S}.{second % 1000:03d}" if calendar else f"{week:4d}{separator}{second / 1e3:10.3f}"
    )
    cells = [time, f"{lat:14.9f}", f"{lon:14.9f}", f"{height:10.4f}", f"{quality:3d}", f"{9:3d}"]
    cells += [f"{s:8.4f}" for s in (0.02, 0.01, 0.03, -0.005, 0.004, 0.001)] + [f"{1.5:6.2f}", f"{9.9:6.1f}"]
    path = tmp_path_factory.getbasetemp() / "printed.pos"
    header = (
        "%  GPST latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) age(s) r\n"
    )
    path.write_text(header.replace(" l", f"{separator}l") + separator.join(cells) + "\n")
    if abs(lat) < 1e-9 and abs(lon) < 1e-9:
        return
    log = read_log(path)
    assert log.gps_s[0] == pytest.approx(week * 604800 + second / 1e3, abs=2e-6)
    assert (log.lat_deg[0], log.lon_deg[0], log.height_m[0]) == pytest.approx((lat, lon, height), abs=6e-5, rel=0)
    assert log.lat_deg[0] == pytest.approx(lat, abs=6e-10)
    assert log.sigma_enu_m[0] == pytest.approx([0.01, 0.02, 0.03])
    assert log.covariance_en_m2[0] == pytest.approx(-(0.005**2))
