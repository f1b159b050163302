"""NMEA: sentences of RTKLIB, gpsbabel and pynmeagps; dates, midnight, heights, damage."""

import datetime
from pathlib import Path

import numpy as np
import pytest

from groundstation.errors import LogError
from groundstation.session.logs.fixes import DEFAULT_SIGMA_M, FixQuality, LogOptions
from groundstation.session.logs.gps_time import gps_from_text, utc_text
from groundstation.session.logs.read import GnssLog, read_log
from tests.complaints import complaint
from tests.session.logs.writers import (
    HEIGHT,
    LAT,
    SEPARATION,
    Place,
    flight,
    gga,
    gst,
    nmea_log,
    rmc,
    with_checksum,
    zda,
)

DATA = Path(__file__).parent / "data"


def log_of(folder: Path, content: bytes, options: LogOptions | None = None) -> GnssLog:
    path = folder / "log.nmea"
    path.write_bytes(content)
    return read_log(path, options)


def test_rtklibs_sentences_are_its_solution() -> None:
    nmea, pos = read_log(DATA / "rtklib.nmea"), read_log(DATA / "calendar.pos")
    assert nmea.gps_s[:12] == pytest.approx(pos.gps_s, abs=1e-6)
    assert nmea.lat_deg[:12] == pytest.approx(pos.lat_deg, abs=2e-9)
    # sea level and separation to a millimetre each
    assert nmea.height_m[:12] == pytest.approx(pos.height_m, abs=2e-3)
    assert set(nmea.quality) == {FixQuality.FIX}
    assert nmea.sigma_enu_m[0] == pytest.approx(DEFAULT_SIGMA_M[FixQuality.FIX])
    assert nmea.remarks == ("rtklib.nmea: no sigmas for 30 of 30 positions: level/up by quality, fix 0.02/0.04 m",)


def test_midnight_and_new_year_as_gpsbabel_writes_them() -> None:
    log = read_log(DATA / "gpsbabel_midnight.nmea")
    assert np.diff(log.gps_s) == pytest.approx([1.0, 1.0, 1.0])
    assert utc_text(log.gps_s[0]) == "2024-12-31T23:59:58Z"
    assert log.quality == (FixQuality.DGPS,) * 3 + (FixQuality.SINGLE,)
    assert (log.lat_deg[0], log.lon_deg[0]) == pytest.approx((51.64, -2.52))
    assert any("steps of 1.9 m: minutes have 3 decimals" in r for r in log.remarks)
    assert any("geoid separation is 0 m in every sentence" in r for r in log.remarks)


def test_a_log_without_a_date_needs_one_and_counts_on_over_midnight() -> None:
    path = DATA / "gpsbabel_no_date.nmea"
    reported = complaint(LogError, lambda: read_log(path))
    assert "got positions without a date (no RMC or ZDA); wanted the UTC date of its first position" in reported
    log = read_log(path, LogOptions(date=datetime.date(2024, 12, 31)))
    assert log.gps_s == pytest.approx(read_log(DATA / "gpsbabel_midnight.nmea").gps_s)


@pytest.mark.parametrize("order", ["rmc first", "gga first", "zda only"])
def test_the_date_may_be_before_or_after(tmp_path: Path, order: str) -> None:
    places = [Place(t) for t in (43206.0, 43207.5, 43208.5, 43210.0)]  # around midnight
    parts = {
        "rmc first": lambda p: rmc(p) + gga(p),
        "gga first": lambda p: gga(p) + rmc(p),
        "zda only": lambda p: zda(p) + gga(p),
    }[order]
    log = log_of(tmp_path, b"".join(parts(p) for p in places))
    start = gps_from_text("2025-05-08T11:59:52Z")
    assert log.gps_s - start == pytest.approx([p.t_s for p in places], abs=1e-6)


def test_a_date_of_a_receiver_without_a_fix_is_not_used(tmp_path: Path) -> None:
    cold = with_checksum("GNRMC,115952.00,V,,,,,,,060180,,,N")
    log = log_of(tmp_path, cold + nmea_log(flight(2)))
    assert utc_text(log.gps_s[0]) == "2025-05-08T11:59:52Z"


def test_weeks_that_began_again(tmp_path: Path) -> None:
    content = nmea_log(flight(3)).replace(b"080525", b"220905")
    lines = [with_checksum(line[1:].rpartition(b"*")[0].decode()) for line in content.split(b"\r\n") if line]
    old = log_of(tmp_path, b"".join(lines))
    assert utc_text(old.gps_s[0]).startswith("2005-09-22")
    log = log_of(tmp_path, b"".join(lines), LogOptions(date=datetime.date(2025, 5, 8)))
    assert utc_text(log.gps_s[0]) == "2025-05-08T11:59:52Z"
    assert any("moved by 1 × 1024 weeks" in r for r in log.remarks)
    reported = complaint(
        LogError, lambda: log_of(tmp_path, b"".join(lines), LogOptions(date=datetime.date(2025, 6, 8)))
    )
    assert "got positions of 2005-09-22; wanted 2025-06-08" in reported


@pytest.mark.parametrize(("day", "fits"), [(29, False), (30, True), (31, True)])
def test_a_date_is_one_of_the_logs_own(tmp_path: Path, day: int, fits: bool) -> None:
    """Expected: of a log across midnight either date, moved by weeks or not; the day before it is another log's."""
    content = b""
    for second, date in (("235959", "301225"), ("000001", "311225")):
        content += with_checksum(f"GPRMC,{second},A,3540.86,N,13945.63,E,0,0,{date},,,A")
        content += with_checksum(f"GPGGA,{second},3540.86,N,13945.63,E,4,12,0.8,40,M,35,M,,")
    given = LogOptions(date=datetime.date(2025, 12, day))
    if fits:
        assert utc_text(log_of(tmp_path, content, given).gps_s[0]) == "2025-12-30T23:59:59Z"
    else:
        reported = complaint(LogError, lambda: log_of(tmp_path, content, given))
        assert "got positions of 2025-12-30 to 2025-12-31; wanted 2025-12-29, the date given for it" in reported


def test_heights_are_sea_level_and_separation(tmp_path: Path) -> None:
    assert log_of(tmp_path, nmea_log(flight(1))).height_m[0] == pytest.approx(HEIGHT, abs=1e-3)
    without = rmc(flight(1)[0]) + gga(flight(1)[0], separation="")
    assert "no geoid separation" in complaint(LogError, lambda: log_of(tmp_path, without))
    given = log_of(tmp_path, without, LogOptions(geoid_separation_m=SEPARATION))
    assert given.height_m[0] == pytest.approx(HEIGHT + SEPARATION, abs=1e-3)


@pytest.mark.parametrize(
    ("quality", "status"), [(1, "single"), (2, "dgps"), (3, "pps"), (4, "fix"), (5, "float"), (8, "simulated")]
)
@pytest.mark.parametrize("talker", ["GP", "GN", "GL", "GA"])
def test_qualities_and_talkers(tmp_path: Path, quality: int, status: str, talker: str) -> None:
    place = flight(1)[0]
    assert log_of(tmp_path, rmc(place) + gga(place, quality, talker)).quality == (FixQuality(status),)


def test_sigmas_of_gst(tmp_path: Path) -> None:
    log = log_of(tmp_path, b"".join(rmc(p) + gga(p) + gst(p, 0.011, 0.012, 0.025) for p in flight(3)))
    assert log.sigma_enu_m == pytest.approx(np.tile([0.011, 0.012, 0.025], (3, 1)))
    assert log.remarks == ()


def test_no_fix_and_dead_reckoning_are_not_positions(tmp_path: Path) -> None:
    a, b, c = flight(3)
    log = log_of(tmp_path, rmc(a) + gga(a) + gga(b, 0) + gga(c, 6))
    assert len(log.gps_s) == 1
    assert log.remarks[:2] == (
        "log.nmea: left out 1 × GGA without a fix (first: line 3)",
        "log.nmea: left out 1 × GGA of dead reckoning (first: line 4)",
    )


@pytest.mark.parametrize("cut", [1, 3, 4, 6, 20, 40])
def test_a_cut_line_is_no_position(tmp_path: Path, cut: int) -> None:
    a, b, c = flight(3)
    log = log_of(tmp_path, rmc(a) + gga(a) + gga(b)[: -2 - cut] + b"\r\n" + gga(c))
    assert len(log.gps_s) == 2
    assert "1 × sentence cut short, garbled or without a checksum (first: line 3)" in log.remarks[0]


@pytest.mark.parametrize("fields", [2, 4, 6, 9])
def test_a_sentence_with_too_few_fields_is_no_position(tmp_path: Path, fields: int) -> None:
    a, b, c = flight(3)
    short = with_checksum(",".join(gga(b)[1:].rpartition(b"*")[0].decode().split(",")[:fields]))
    log = log_of(tmp_path, rmc(a) + gga(a) + short + gga(c))
    assert len(log.gps_s) == 2
    assert "(first: line 3)" in log.remarks[0]


def test_a_garbled_digit_is_caught_by_the_checksum(tmp_path: Path) -> None:
    a, b = flight(2)
    log = log_of(tmp_path, rmc(a) + gga(a) + gga(b).replace(b"3540.", b"3546."))
    assert log.lat_deg == pytest.approx([LAT])
    assert "1 × sentence with a wrong checksum (first: line 3)" in log.remarks[0]


def test_binary_between_the_lines_does_not_matter(tmp_path: Path) -> None:
    a, b = flight(2)
    log = log_of(tmp_path, rmc(a) + b"\xb5\x62\x00\xff" + gga(a) + b"\xd3\x00\x13\x0a" + gga(b))
    assert len(log.gps_s) == 2


def test_a_wild_time_costs_itself_only(tmp_path: Path) -> None:
    places = flight(8)
    places[3] = Place(3600.0)
    log = log_of(tmp_path, nmea_log(places))
    assert len(log.gps_s) == 7
    assert "1 × position whose time does not grow (first: position 4)" in log.remarks[0]


def test_a_date_without_a_fix_has_no_effect(tmp_path: Path) -> None:
    """Expected: a receiver that has no fix yet may show any date at the right second."""
    place, wrong = Place(1.0), Place(1.0 - 100 * 86400.0)
    log = log_of(tmp_path, rmc(wrong, status="V") + gga(place) + rmc(place))
    assert utc_text(log.gps_s[0])[:10] == place.utc.date().isoformat()
    # of a fix it would be accepted
    accepted = log_of(tmp_path, rmc(wrong) + gga(place))
    assert utc_text(accepted.gps_s[0])[:10] == wrong.utc.date().isoformat()


@pytest.mark.parametrize("dated", ["before", "after"])
def test_a_position_on_the_other_side_of_midnight_from_its_date(tmp_path: Path, dated: str) -> None:
    """Expected: the day before where the date came after midnight, the day after where it came before."""
    eve, morning = Place(43207.5), Place(43208.5)
    assert (eve.utc.date() + datetime.timedelta(days=1)) == morning.utc.date()
    content = rmc(eve) + gga(eve) + gga(morning) if dated == "before" else gga(eve) + gga(morning) + rmc(morning)
    log = log_of(tmp_path, content)
    assert [utc_text(t)[:10] for t in log.gps_s] == [p.utc.date().isoformat() for p in (eve, morning)]


@pytest.mark.parametrize("first", ["gga", "gst"])
def test_sigmas_find_their_positions_in_a_long_log(tmp_path: Path, first: str) -> None:
    """Expected: each position its own, though the log has the same second of the day again elsewhere."""
    places = flight(1003)
    pairs = [(gga(p), gst(p, 0.001 * (k % 50 + 1), 0.02, 0.03)) for k, p in enumerate(places)]
    content = rmc(places[0]) + b"".join(a + b if first == "gga" else b + a for a, b in pairs)
    log = log_of(tmp_path, content)
    assert log.sigma_enu_m[:, 0] == pytest.approx([0.001 * (k % 50 + 1) for k in range(1003)])
    assert log.sigma_enu_m[0, 1:] == pytest.approx([0.02, 0.03])
