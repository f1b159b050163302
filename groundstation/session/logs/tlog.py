"""A ground station's MAVLink log (.tlog): GPS_RAW_INT or GPS2_RAW, with UTC by SYSTEM_TIME; decoded by pymavlink.

A position has the time since boot; SYSTEM_TIME relates it to UTC. The ground computer's own stamps are the arrival
times over a radio that may delay a message. They are used only without SYSTEM_TIME, with a note.
"""

import math
import statistics
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from groundstation.errors import LogError, MissingExtraError
from groundstation.session.logs.fixes import (
    FixQuality,
    Heights,
    LogFix,
    LogOptions,
    ReadingNotes,
    check_count,
    plausible,
    usable_sigma,
)
from groundstation.session.logs.gps_time import TimeScale, civil_from_unix

_QUALITY = {3: FixQuality.SINGLE, 4: FixQuality.DGPS, 5: FixQuality.FLOAT, 6: FixQuality.FIX}
_KINDS = ("GPS_RAW_INT", "GPS2_RAW")
_SYSTEM_TIME, _GPS_RAW_INT, _GPS2_RAW = 2, 24, 124
_V1, _V2 = 0xFE, 0xFD
_MAX_BYTES = 1_000_000_000
_UNIX_US = 1e15
_MAX_CLOCK_STEP_S = 0.5


def read_tlog(path: Path, options: LogOptions, remarks: ReadingNotes) -> list[LogFix]:
    """Read the positions of a .tlog. Raises `LogError` where heights have no reference."""
    try:
        from pymavlink.dialects.v20 import common
    except ImportError as error:
        raise MissingExtraError("reading MAVLink logs", "logs") from error
    if path.stat().st_size > _MAX_BYTES:
        raise LogError(path.name, got="a larger file", wanted=f"at most {_MAX_BYTES} bytes of log")
    kind = _KINDS[min(max(options.instance or 0, 0), 1)]
    remarks.used.add("instance")
    positions: list[tuple[float, Any]] = []
    clocks: dict[int, list[tuple[float, float]]] = {}
    decoder = common.MAVLink(None)
    for stamp_us, packet in packets(path.read_bytes(), remarks):
        try:
            message = decoder.decode(bytearray(packet))
        except Exception:  # noqa: BLE001 - a wrong checksum, a field too short: pymavlink has many errors
            remarks.count("message that pymavlink does not accept")
            continue
        if message.get_type() == kind:
            positions.append((stamp_us * 1e-6, message))
            if len(positions) % 10_000 == 0:
                check_count(path, positions)
        elif message.get_type() == "SYSTEM_TIME" and message.time_unix_usec > _UNIX_US:
            pair = (stamp_us * 1e-6, message.time_unix_usec * 1e-6 - message.time_boot_ms * 1e-3)
            clocks.setdefault(message.get_srcSystem(), []).append(pair)
    return _Reader(path, options, remarks, clocks).fixes(positions)


def packets(content: bytes, remarks: ReadingNotes) -> Iterator[tuple[int, bytes]]:
    """Yield stamp in µs and bytes of each packet that is read here; after an invalid one it searches for the next."""
    place, lost = 0, False
    while place + 16 <= len(content):
        magic, length = content[place + 8], content[place + 9]
        size = 0
        if magic == _V1:
            size = 8 + length
        elif magic == _V2:
            size = 12 + length + (13 if content[place + 10] & 1 else 0)
        # whole, and followed by another packet or by the end
        end = place + 8 + size
        follows = end + 8 >= len(content) or content[end + 8] in (_V1, _V2)
        if not size or end > len(content) or not follows:
            if not lost:
                remarks.count("stretch that is no MAVLink, or cut short", f"byte {place}")
            place, lost = place + 1, True
            continue
        lost = False
        number = content[place + 13] if magic == _V1 else int.from_bytes(content[place + 15 : place + 18], "little")
        if number in (_SYSTEM_TIME, _GPS_RAW_INT, _GPS2_RAW):
            yield _stamp(content, place), content[place + 8 : end]
        place = end


def _stamp(content: bytes, place: int) -> int:
    return int.from_bytes(content[place : place + 8], "big")


class _Reader:
    """Turns messages into fixes."""

    def __init__(
        self, path: Path, options: LogOptions, remarks: ReadingNotes, clocks: dict[int, list[tuple[float, float]]]
    ) -> None:
        self._heights = Heights(path, options)
        self._remarks = remarks
        self._boot: dict[int, float] = {}
        for system, pairs in clocks.items():
            offsets = [offset for _, offset in pairs]
            self._boot[system] = statistics.median(offsets)
            if max(offsets) - min(offsets) > _MAX_CLOCK_STEP_S:
                remarks.note("SYSTEM_TIME jumps: the autopilot booted again, or its clock was set; its median is used")

    def fixes(self, positions: list[tuple[float, Any]]) -> list[LogFix]:
        """Return the usable positions of one vehicle, the first that has any."""
        found: list[LogFix] = []
        system = None
        for stamp_s, message in positions:
            quality = _QUALITY.get(message.fix_type)
            if quality is None:
                self._remarks.count("position without a 3-D fix")
                continue
            system = message.get_srcSystem() if system is None else system
            if message.get_srcSystem() != system:
                self._remarks.count(f"position of another vehicle than {system}")
                continue
            fix = self._fix(stamp_s, message, quality)
            if plausible(fix):
                found.append(fix)
            else:
                self._remarks.count("position that is no place on Earth")
        return found

    def _fix(self, stamp_s: float, message: Any, quality: FixQuality) -> LogFix:
        day, second = civil_from_unix(min(self._unix(stamp_s, message), 1e11))
        ellipsoid = getattr(message, "alt_ellipsoid", 0)
        height = ellipsoid * 1e-3 if ellipsoid else self._heights.ellipsoid(message.alt * 1e-3, None)
        horizontal, up = getattr(message, "h_acc", 0) * 1e-3 / math.sqrt(2.0), getattr(message, "v_acc", 0) * 1e-3
        return LogFix(
            day=day,
            second=second,
            scale=TimeScale.UTC,
            lat_deg=message.lat * 1e-7,
            lon_deg=message.lon * 1e-7,
            height_m=height,
            quality=quality,
            sigma_enu_m=usable_sigma(horizontal, horizontal, up),
        )

    def _unix(self, stamp_s: float, message: Any) -> float:
        """Return the Unix time of a position."""
        if message.time_usec > _UNIX_US:
            return message.time_usec * 1e-6
        boot = self._boot.get(message.get_srcSystem())
        if boot is not None:
            return boot + message.time_usec * 1e-6
        self._remarks.note("no SYSTEM_TIME: times are when messages reached the ground computer, by its own clock")
        return stamp_s
