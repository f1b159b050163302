"""UBX, ULog, ArduPilot's .bin and .tlog: units, times, qualities, damage."""

import contextlib
import io
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from pyulog import ULog

from groundstation.errors import LogError
from groundstation.session.logs.fixes import FixQuality, LogOptions, ReadingNotes
from groundstation.session.logs.gps_time import gps_from_text
from groundstation.session.logs.read import GnssLog, read_log
from groundstation.session.logs.ubx import ubx_frames
from tests.complaints import complaint
from tests.session.logs.writers import (
    HEIGHT,
    LAT,
    LON,
    SEPARATION,
    Place,
    dataflash,
    flight,
    hpposllh,
    pvt,
    relposned,
    rmc,
    tlog,
    ubx_log,
    ulog,
    with_fletcher,
)

START = gps_from_text("2025-05-08T11:59:52Z")
GIVEN = LogOptions(geoid_separation_m=SEPARATION)


def log_of(folder: Path, content: bytes, suffix: str, options: LogOptions | None = None) -> GnssLog:
    path = folder / f"log{suffix}"
    path.write_bytes(content)
    return read_log(path, options)


def same_flight(log: GnssLog, n: int = 6, *, metres: float = 2e-3) -> None:
    places = flight(n)
    assert START is not None
    assert log.gps_s - START == pytest.approx([p.t_s for p in places], abs=1.1e-3)
    assert log.lat_deg == pytest.approx([p.lat for p in places], abs=6e-8)
    assert log.lon_deg == pytest.approx([p.lon for p in places], abs=6e-8)
    assert log.height_m == pytest.approx([p.height for p in places], abs=metres)
    assert set(log.quality) == {FixQuality.FIX}


# -------------------------------------------------------------------------------- UBX
def test_ubx_as_pyubx2_writes_it(tmp_path: Path) -> None:
    log = log_of(tmp_path, ubx_log(flight()), ".ubx")
    same_flight(log)
    # HPPOSLLH next to PVT: 1e-9 degrees
    assert log.lat_deg == pytest.approx([p.lat for p in flight()], abs=6e-10)
    assert log.sigma_enu_m[0] == pytest.approx([0.010 / math.sqrt(2), 0.010 / math.sqrt(2), 0.015])
    assert log.remarks == ()


def test_pvt_alone_in_millimetres(tmp_path: Path) -> None:
    log = log_of(tmp_path, b"".join(map(pvt, flight())), ".ubx")
    same_flight(log)
    assert log.sigma_enu_m[0] == pytest.approx([0.014 / math.sqrt(2), 0.014 / math.sqrt(2), 0.020])


def test_nanoseconds_may_be_negative(tmp_path: Path) -> None:
    midnight = Place(43208.0)
    log = log_of(tmp_path, pvt(Place(43207.0)) + pvt(midnight, nano=-200_000_000), ".ubx")
    assert log.gps_s - START == pytest.approx([43207.0, 43207.8], abs=1e-6)


@pytest.mark.parametrize(
    ("fields", "quality"),
    [
        ({"carrSoln": 2}, "fix"),
        ({"carrSoln": 1}, "float"),
        ({"carrSoln": 0}, "dgps"),
        ({"carrSoln": 0, "diffSoln": 0}, "single"),
    ],
)
def test_qualities_of_ubx(tmp_path: Path, fields: dict[str, int], quality: str) -> None:
    assert log_of(tmp_path, pvt(flight()[0], **fields), ".ubx").quality == (FixQuality(quality),)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"gnssFixOk": 0}, "without a 3-D fix"),
        ({"fixType": 2}, "without a 3-D fix"),
        ({"fixType": 1}, "without a 3-D fix"),
        ({"validTime": 0}, "without a valid date"),
        ({"invalidLlh": 1}, "without a 3-D fix"),
    ],
)
def test_ubx_entries_without_a_fix_are_skipped(tmp_path: Path, fields: dict[str, int], reason: str) -> None:
    a, b = flight(2)
    log = log_of(tmp_path, pvt(a) + pvt(b, **fields), ".ubx")
    assert len(log.gps_s) == 1
    assert f"1 × NAV-PVT {reason}" in log.remarks[0]


def test_a_baseline_in_centimetres_from_a_base(tmp_path: Path) -> None:
    place = flight(1)[0]
    content = pvt(place, lat=LAT + 1e-5) + relposned(place, 11095, 4526, -1501)
    log = log_of(tmp_path, content, ".ubx", LogOptions(base_deg_m=(35.68, 139.76, 60.0)))
    assert (log.lat_deg[0], log.lon_deg[0]) == pytest.approx((LAT, LON), abs=1e-7)
    assert log.height_m[0] == pytest.approx(HEIGHT, abs=0.02)
    assert log.sigma_enu_m[0] == pytest.approx([0.007, 0.008, 0.020])
    bad = pvt(place) + relposned(place, 11095, 4526, -1501, relPosValid=0)
    reported = complaint(LogError, lambda: log_of(tmp_path, bad, ".ubx", LogOptions(base_deg_m=(35.68, 139.76, 60.0))))
    assert "1 × NAV-PVT without a valid NAV-RELPOSNED of the same epoch" in reported


@pytest.mark.parametrize("place", [-2, -1])
def test_ubx_has_two_bytes_of_checksum(tmp_path: Path, place: int) -> None:
    a, b = flight(2)
    spoilt = bytearray(pvt(b))
    spoilt[place] ^= 1
    log = log_of(tmp_path, pvt(a) + bytes(spoilt), ".ubx")
    assert len(log.gps_s) == 1
    assert "1 × message with a wrong checksum" in log.remarks[0]


def test_ubx_between_other_messages_and_damaged(tmp_path: Path) -> None:
    a, b, c = flight(3)
    spoilt = bytearray(pvt(b))
    spoilt[40] ^= 1
    log = log_of(tmp_path, b"\xd3\x00\x02" + rmc(a) + pvt(a) + bytes(spoilt) + rmc(b) + pvt(c) + pvt(c)[:50], ".ubx")
    assert len(log.gps_s) == 2
    assert "1 × message with a wrong checksum" in log.remarks[0]
    assert "1 × message cut short at the end" in log.remarks[1]


def test_ubx_without_pvt_has_no_date(tmp_path: Path) -> None:
    reported = complaint(LogError, lambda: log_of(tmp_path, hpposllh(flight(1)[0]), ".ubx"))
    assert reported == "log.ubx: got UBX without NAV-PVT; wanted NAV-PVT, which has the date and the quality"


# -------------------------------------------------------------------------------- ULog
@pytest.mark.parametrize("topic", ["sensor_gps", "vehicle_gps_position"])
@pytest.mark.parametrize("old", [False, True])
def test_ulog_with_the_units_of_before_and_after_1_14(tmp_path: Path, topic: str, old: bool) -> None:
    log = log_of(tmp_path, ulog(flight(), old=old, topic=topic), ".ulg")
    same_flight(log)
    assert log.sigma_enu_m[0] == pytest.approx([0.0099, 0.0099, 0.02], abs=1e-4)


def test_ulog_as_pyulog_writes_it(tmp_path: Path) -> None:
    source = ULog(io.BytesIO(ulog(flight())))
    source.write_ulog(str(tmp_path / "again.ulg"))
    same_flight(read_log(tmp_path / "again.ulg"))


def test_ulog_heights(tmp_path: Path) -> None:
    content = ulog(flight(), ellipsoid=False)
    assert "no geoid separation" in complaint(LogError, lambda: log_of(tmp_path, content, ".ulg"))
    same_flight(log_of(tmp_path, content, ".ulg", GIVEN))


def test_a_truncated_ulog_keeps_its_beginning(tmp_path: Path) -> None:
    content = ulog(flight())
    assert len(log_of(tmp_path, content[:-30], ".ulg").gps_s) == 5


def test_ulog_without_utc_or_fix_or_topic(tmp_path: Path) -> None:
    assert "6 × row without UTC" in complaint(LogError, lambda: log_of(tmp_path, ulog(flight(), utc=False), ".ulg"))
    assert "6 × row without a 3-D fix" in complaint(
        LogError, lambda: log_of(tmp_path, ulog(flight(), fix_type=8), ".ulg")
    )
    reported = complaint(LogError, lambda: log_of(tmp_path, ulog(flight(), topic="vehicle_attitude"), ".ulg"))
    assert reported.startswith("log.ulg: got no positions; wanted the topic vehicle_gps_position or sensor_gps")
    reported = complaint(LogError, lambda: log_of(tmp_path, ulog(flight()), ".ulg", LogOptions(instance=1)))
    assert reported.startswith("log.ulg: got sensor_gps[0]; wanted the topic")
    assert "no ULog that pyulog reads" in complaint(LogError, lambda: log_of(tmp_path, b"ULog\x01\x12\x35\x01", ".ulg"))


@pytest.mark.parametrize("claimed", [1, 200, 1000, 65535])
def test_a_ulog_whose_last_message_is_longer_than_the_file_ends(tmp_path: Path, claimed: int) -> None:
    """A message of a type unknown to pyulog, where it returned to the same place without end."""
    header = b"ULog\x01\x12\x35\x01" + bytes(8)
    message = claimed.to_bytes(2, "little") + b"\x00"
    assert "got no positions" in complaint(LogError, lambda: log_of(tmp_path, header + message, ".ulg"))
    assert "got no positions" in complaint(LogError, lambda: log_of(tmp_path, header + 3 * message, ".ulg"))


# -------------------------------------------------------------------------------- ArduPilot
def test_dataflash_by_week_and_milliseconds(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    log = log_of(tmp_path, dataflash(flight()), ".bin", GIVEN)
    same_flight(log, metres=6e-3)
    assert log.sigma_enu_m[0] == pytest.approx([0.01 / math.sqrt(2), 0.01 / math.sqrt(2), 0.02])
    assert capfd.readouterr() == ("", "")


def test_dataflash_heights_are_above_sea_level_and_und_is_shown_not_used(tmp_path: Path) -> None:
    reported = complaint(LogError, lambda: log_of(tmp_path, dataflash(flight()), ".bin"))
    assert "(Und = -37.73 m, its sign depends on the receiver)" in reported
    reported = complaint(LogError, lambda: log_of(tmp_path, dataflash(flight(), und=None), ".bin"))
    assert "no geoid separation;" in reported


@pytest.mark.parametrize("length", [0, 1, 2])
@pytest.mark.parametrize("kind", [0x80, 0x81, 0x82])
def test_dataflash_with_messages_shorter_than_their_header_ends(tmp_path: Path, kind: int, length: int) -> None:
    """A damaged description, after which the same message was repeated without end."""
    content = dataflash(flight())
    at = content.index(bytes([0xA3, 0x95, 0x80, kind]))
    content = content[: at + 4] + bytes([length]) + content[at + 5 :]
    logs = (content, content + content, content[at:] + content)
    for log in logs:
        with contextlib.suppress(LogError):
            assert len(log_of(tmp_path, log, ".bin", GIVEN).gps_s) <= 12


def test_dataflash_without_a_fix_and_of_two_receivers(tmp_path: Path) -> None:
    reported = complaint(LogError, lambda: log_of(tmp_path, dataflash(flight(), status=2), ".bin", GIVEN))
    assert "6 × GPS message without a 3-D fix" in reported
    content = dataflash(flight(3))
    other = dataflash([Place(0.1, LAT + 0.001)], receiver=1)
    both = content + other[89 * 3 :]
    log = log_of(tmp_path, both, ".bin", GIVEN)
    assert len(log.gps_s) == 3
    assert "1 × GPS message of another receiver than 0" in log.remarks[0]
    second = log_of(tmp_path, both, ".bin", LogOptions(geoid_separation_m=SEPARATION, instance=1))
    assert second.lat_deg == pytest.approx([LAT + 0.001])


def test_dataflash_damaged(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    content = dataflash(flight())
    log = log_of(tmp_path, content[:-40], ".bin", GIVEN)
    assert len(log.gps_s) == 5
    hole = content[:-150] + b"\x00" * 30 + content[-150:]
    assert len(log_of(tmp_path, hole, ".bin", GIVEN).gps_s) >= 4
    reported = complaint(LogError, lambda: log_of(tmp_path, b"\xa3\x95", ".bin", GIVEN))
    assert reported.startswith("log.bin: got no")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("boot", [True, False])
def test_tlog_by_system_time_not_by_arrival(tmp_path: Path, boot: bool) -> None:
    log = log_of(tmp_path, tlog(flight(), boot=boot), ".tlog")
    same_flight(log)
    assert log.sigma_enu_m[0] == pytest.approx([0.014 / math.sqrt(2), 0.014 / math.sqrt(2), 0.020])
    assert log.remarks == ()


def test_tlog_without_system_time_states_the_origin_of_its_times(tmp_path: Path) -> None:
    log = log_of(tmp_path, tlog(flight(), system_time=False, late_s=0.4), ".tlog")
    assert log.gps_s[0] - START == pytest.approx(0.4, abs=1e-6)
    assert "times are when messages reached the ground computer" in log.remarks[0]


def test_tlog_heights_and_damage(tmp_path: Path) -> None:
    content = tlog(flight(), ellipsoid=False)
    assert "no geoid separation" in complaint(LogError, lambda: log_of(tmp_path, content, ".tlog"))
    same_flight(log_of(tmp_path, content, ".tlog", GIVEN))
    cut = log_of(tmp_path, b"rubbish" + content[:-9], ".tlog", GIVEN)
    assert len(cut.gps_s) == 5
    assert "stretch that is no MAVLink" in cut.remarks[0]
    spoilt = bytearray(content)
    spoilt[content.rindex(struct.pack("<i", round(flight()[5].lat * 1e7)))] ^= 4
    log = log_of(tmp_path, bytes(spoilt), ".tlog", GIVEN)
    assert len(log.gps_s) == 5
    assert np.all(np.abs(log.lat_deg - LAT) < 1e-4)


@pytest.mark.parametrize(("count", "summed"), [(200, 1 << 22), (60_000, 1 << 22), (60_000, 1000)])
def test_ubx_between_false_beginnings_is_found_as_before(
    count: int, summed: int, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: whole messages, each once and in order, whatever similar bytes are between them."""
    monkeypatch.setattr("groundstation.session.logs.ubx._SUMMED_BYTES", summed)
    frames = []
    content = b""
    while len(frames) < 40:
        body = rng.integers(0, 256, rng.integers(0, 2000), dtype=np.uint8).tobytes()
        frame = with_fletcher(b"\xb5\x62\x05\x55" + struct.pack("<H", len(body)) + body + b"\0\0")
        frames.append(frame)
        # a beginning whose message would reach past the end of all, or over many that are whole
        content += b"\xb5\x62" * int(rng.integers(0, count // 40)) + b"\0" * 8 + frame
    found = [frame for _, frame in ubx_frames(content + b"\xb5\x62\x01\x07\xff\xff", ReadingNotes("x"))]
    whole = [frame for frame in found if frame in frames]
    assert [frame for frame in frames if frame in found] == whole
    assert len(whole) > 30
