"""Logs written by independent writers (pynmeagps, pyubx2, pymavlink), and by the formats' own descriptions.

ULog and ArduPilot's .bin have no writer that makes a log from nothing: these two are built here by
their published descriptions and read back by pyulog and pymavlink as a check.
"""

import datetime
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import common
from pynmeagps import NMEAMessage
from pyubx2 import UBXMessage

GPS_WEEK = 2365
UTC = datetime.datetime(2025, 5, 8, 11, 59, 52, tzinfo=datetime.UTC)
UNIX_S = UTC.timestamp()
LAT, LON, HEIGHT, SEPARATION = 35.681, 139.7605, 75.01, 37.726


@dataclass(frozen=True)
class Place:
    """One epoch; ``t_s`` after UTC."""

    t_s: float
    lat: float = LAT
    lon: float = LON
    height: float = HEIGHT

    @property
    def utc(self) -> datetime.datetime:
        return UTC + datetime.timedelta(seconds=self.t_s)


def flight(n: int = 6, step_s: float = 0.2) -> list[Place]:
    return [Place(round(k * step_s, 6), LAT + 2e-6 * k, LON - 1e-6 * k, HEIGHT + 0.3 * k) for k in range(n)]


# -------------------------------------------------------------------------------- NMEA, by pynmeagps
def gga(place: Place, quality: int = 4, talker: str = "GN", separation: float | str = SEPARATION) -> bytes:
    sea = place.height - (separation if isinstance(separation, float) else 0.0)
    message = NMEAMessage(
        talker,
        "GGA",
        0,
        lat=place.lat,
        NS="N" if place.lat >= 0 else "S",
        lon=place.lon,
        EW="E" if place.lon >= 0 else "W",
        time=place.utc.time(),
        quality=quality,
        numSV=12,
        HDOP=0.8,
        alt=round(sea, 4),
        altUnit="M",
        sep=separation,
        sepUnit="M",
        hpnmeamode=1,
    )
    return bytes(message.serialize())


def rmc(place: Place, status: str = "A", talker: str = "GN") -> bytes:
    message = NMEAMessage(
        talker,
        "RMC",
        0,
        lat=place.lat,
        NS="N",
        lon=place.lon,
        EW="E",
        time=place.utc.time(),
        date=place.utc.date(),
        status=status,
        posMode="R",
        hpnmeamode=1,
    )
    return bytes(message.serialize())


def zda(place: Place) -> bytes:
    utc = place.utc
    return bytes(NMEAMessage("GN", "ZDA", 0, time=utc.time(), day=utc.day, month=utc.month, year=utc.year).serialize())


def gst(place: Place, east: float, north: float, up: float) -> bytes:
    message = NMEAMessage("GN", "GST", 0, time=place.utc.time(), stdLat=north, stdLong=east, stdAlt=up)
    return bytes(message.serialize())


def with_checksum(body: str) -> bytes:
    total = 0
    for code in body.encode("latin-1"):
        total ^= code
    return f"${body}*{total:02X}\r\n".encode("latin-1")


def nmea_log(places: Iterable[Place]) -> bytes:
    return b"".join(rmc(p) + gga(p) for p in places)


# -------------------------------------------------------------------------------- UBX, by pyubx2
def itow(place: Place) -> int:
    return round((388810.0 + place.t_s) * 1000)


def pvt(place: Place, **other: Any) -> bytes:
    utc = place.utc
    values: dict[str, Any] = {
        "iTOW": itow(place),
        "year": utc.year,
        "month": utc.month,
        "day": utc.day,
        "hour": utc.hour,
        "min": utc.minute,
        "second": utc.second,
        "validDate": 1,
        "validTime": 1,
        "fullyResolved": 1,
        "nano": utc.microsecond * 1000,
        "fixType": 3,
        "gnssFixOk": 1,
        "diffSoln": 1,
        "carrSoln": 2,
        "numSV": 20,
        "lon": place.lon + 1e-9,
        "lat": place.lat + 1e-9,
        "height": round(place.height * 1000),
        "hMSL": round((place.height - SEPARATION) * 1000),
        "hAcc": 14,
        "vAcc": 20,
    } | other
    return bytes(UBXMessage("NAV", "NAV-PVT", 0, **values).serialize())


def hpposllh(place: Place, **other: Any) -> bytes:
    # pyubx2 takes the standard part and the high-precision part apart
    def parts(value: float, coarse: float, fine: float) -> tuple[float, float]:
        whole = round(value / coarse)
        # pyubx2 cuts off where it should round
        high = round((value - whole * coarse) / fine)
        return whole * coarse + 0.01 * coarse, high * fine + 0.01 * fine * (1 if high >= 0 else -1)

    lat, lat_hp = parts(place.lat, 1e-7, 1e-9)
    lon, lon_hp = parts(place.lon, 1e-7, 1e-9)
    values: dict[str, Any] = {
        "iTOW": itow(place),
        "lon": lon,
        "lat": lat,
        "_HPlon": lon_hp,
        "_HPlat": lat_hp,
        "height": round(place.height * 1000),
        "hMSL": 0,
        "_HPheight": 0.0,
        "hAcc": 10.0,
        "vAcc": 15.0,
    } | other
    return bytes(UBXMessage("NAV", "NAV-HPPOSLLH", 0, **values).serialize())


def relposned(place: Place, n_cm: int, e_cm: int, d_cm: int, **other: Any) -> bytes:
    values: dict[str, Any] = {
        "version": 1,
        "iTOW": itow(place),
        "relPosN": n_cm,
        "relPosE": e_cm,
        "relPosD": d_cm,
        "accN": 8.0,
        "accE": 7.0,
        "accD": 20.0,
        "gnssFixOK": 1,
        "diffSoln": 1,
        "relPosValid": 1,
        "carrSoln": 2,
    } | other
    return bytes(UBXMessage("NAV", "NAV-RELPOSNED", 0, **values).serialize())


def ubx_log(places: Iterable[Place]) -> bytes:
    return b"".join(pvt(p) + hpposllh(p) for p in places)


def with_fletcher(frame: bytes) -> bytes:
    """Put the right checksum under a frame whose content was changed."""
    a = b = 0
    for code in frame[2:-2]:
        a = (a + code) & 0xFF
        b = (b + a) & 0xFF
    return frame[:-2] + bytes([a, b])


# -------------------------------------------------------------------------------- ULog, by its description
NEW_FIELDS = (
    "uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;double altitude_msl_m;"
    "double altitude_ellipsoid_m;float eph;float epv;uint8_t fix_type;"
)
OLD_FIELDS = (
    "uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;int32_t alt;int32_t alt_ellipsoid;"
    "float eph;float epv;uint8_t fix_type;"
)


def ulog(
    places: Iterable[Place],
    *,
    old: bool = False,
    topic: str = "sensor_gps",
    multi_id: int = 0,
    fix_type: int = 6,
    ellipsoid: bool = True,
    utc: bool = True,
) -> bytes:
    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000)
    out += message("B", bytes(40))
    out += message("F", f"{topic}:{OLD_FIELDS if old else NEW_FIELDS}".encode())
    out += message("A", struct.pack("<BH", multi_id, 7) + topic.encode())
    for p in places:
        stamp = 5_000_000 + round(p.t_s * 1e6)
        time = round((UNIX_S + p.t_s) * 1e6) if utc else 0
        sea = p.height - SEPARATION
        if old:
            where = struct.pack(
                "<iiii", round(p.lat * 1e7), round(p.lon * 1e7), round(sea * 1000), round(p.height * 1000 * ellipsoid)
            )
        else:
            where = struct.pack("<dddd", p.lat, p.lon, sea, p.height * ellipsoid)
        out += message("D", struct.pack("<HQQ", 7, stamp, time) + where + struct.pack("<ffB", 0.014, 0.02, fix_type))
    return out


# -------------------------------------------------------------------------------- .bin, by its description
def dataflash(places: Iterable[Place], *, status: int = 6, und: float | None = -SEPARATION, receiver: int = 0) -> bytes:
    def fmt(kind: int, length: int, name: str, form: str, labels: str) -> bytes:
        fields = (kind, length, name.encode(), form.encode(), labels.encode())
        return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *fields)

    out = fmt(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    out += fmt(0x81, 3 + 47, "GPS", "QBBIHBcLLeffff", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw")
    out += fmt(0x82, 3 + 21, "GPA", "QBCCCHf", "TimeUS,I,VDop,HAcc,VAcc,Delta,Und")
    for p in places:
        boot = round((50 + p.t_s) * 1e6)
        if und is not None:
            out += b"\xa3\x95\x82" + struct.pack("<QBHHHHf", boot, receiver, 110, 1, 2, 200, und)
        out += b"\xa3\x95\x81" + struct.pack(
            "<QBBIHBhiiiffff",
            boot,
            receiver,
            status,
            itow(p),
            GPS_WEEK,
            20,
            60,
            round(p.lat * 1e7),
            round(p.lon * 1e7),
            round((p.height - SEPARATION) * 100),
            15.0,
            90.0,
            0.5,
            0.0,
        )
    return out


# -------------------------------------------------------------------------------- .tlog, by pymavlink
def tlog(
    places: Iterable[Place],
    *,
    boot: bool = True,
    system_time: bool = True,
    ellipsoid: bool = True,
    late_s: float = 0.4,
    fields: Mapping[str, int] | None = None,
) -> bytes:
    link = common.MAVLink(None, srcSystem=1, srcComponent=1)
    out = b""
    for p in places:
        stamp = struct.pack(">Q", round((UNIX_S + p.t_s + late_s) * 1e6))
        if system_time:
            out += stamp + link.system_time_encode(round((UNIX_S + p.t_s) * 1e6), round((50 + p.t_s) * 1e3)).pack(link)
        time = round((50 + p.t_s) * 1e6) if boot else round((UNIX_S + p.t_s) * 1e6)
        values: dict[str, int] = {
            "time_usec": time,
            "fix_type": 6,
            "lat": round(p.lat * 1e7),
            "lon": round(p.lon * 1e7),
            "alt": round((p.height - SEPARATION) * 1000),
            "eph": 80,
            "epv": 100,
            "vel": 1500,
            "cog": 9000,
            "satellites_visible": 20,
            "alt_ellipsoid": round(p.height * 1000) if ellipsoid else 0,
            "h_acc": 14,
            "v_acc": 20,
        } | dict(fields or {})
        out += stamp + link.gps_raw_int_encode(**values).pack(link)
    return out
