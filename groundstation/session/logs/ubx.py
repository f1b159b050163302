"""u-blox UBX: NAV-PVT, refined by NAV-HPPOSLLH, or NAV-RELPOSNED from a known base; decoded by pyubx2.

Frames are found here, by their sync bytes, length and checksum, because NMEA and RTCM may be between them.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.errors import LogError, MissingExtraError
from groundstation.geometry.geodesy import ecef_from_enu, geodetic_from_ecef
from groundstation.session.logs.fixes import (
    FixQuality,
    LogFix,
    LogOptions,
    ReadingNotes,
    check_count,
    plausible,
    usable_sigma,
)
from groundstation.session.logs.gps_time import DAY_S, TimeScale, day_number

_SYNC = b"\xb5\x62"
_PVT, _HPPOSLLH, _RELPOSNED = b"\x01\x07", b"\x01\x14", b"\x01\x3c"
_MAX_BYTES = 1_000_000_000
# lengths of the three messages in all their versions; messages of other lengths are not decoded
_LENGTHS = {_PVT: (84, 92), _HPPOSLLH: (36,), _RELPOSNED: (40, 64)}
_HEAD_BYTES, _END_BYTES, _MAX_PAYLOAD = 6, 2, 0xFFFF
# so much is summed at a time
_SUMMED_BYTES = 1 << 22
_PER_MM = 1e-3
_PER_CM = 1e-2


def read_ubx(path: Path, options: LogOptions, remarks: ReadingNotes) -> list[LogFix]:
    """Read a log of UBX messages. Raises `LogError` where it has no NAV-PVT, which alone has date and quality."""
    parse = _parser()
    if path.stat().st_size > _MAX_BYTES:
        raise LogError(path.name, got="a larger file", wanted=f"at most {_MAX_BYTES} bytes of UBX")
    pvt: dict[int, Any] = {}
    order: list[Any] = []
    fine: dict[tuple[int, int], Any] = {}
    for place, frame in ubx_frames(path.read_bytes(), remarks):
        if frame[2:4] not in _LENGTHS:
            continue
        message = parse(frame) if len(frame) - _HEAD_BYTES - _END_BYTES in _LENGTHS[frame[2:4]] else None
        if message is None:
            remarks.count("message that pyubx2 does not understand", f"byte {place}")
        elif frame[2:4] == _PVT:
            order.append(message)
            pvt[message.iTOW] = message
        else:
            fine[(frame[3], message.iTOW)] = message
        if len(order) % 10_000 == 0:
            check_count(path, order)
    if not order and fine:
        raise LogError(path.name, got="UBX without NAV-PVT", wanted="NAV-PVT, which has the date and the quality")
    fixes = []
    for message in order:
        try:
            fix = _fix(message, fine, options, remarks)
        except AttributeError:
            # an older receiver's shorter message
            remarks.count("message without the fields that are needed")
            continue
        if fix is not None:
            fixes.append(fix)
    return fixes


def ubx_frames(content: bytes, remarks: ReadingNotes) -> Iterator[tuple[int, bytes]]:
    """Yield place and bytes of each whole frame; one with a wrong checksum, or truncated, is counted and skipped."""
    sums = _Sums(content)
    place = content.find(_SYNC)
    while place >= 0:
        end = place + 8 + int.from_bytes(content[place + 4 : place + 6], "little")
        if len(content) < place + 8 or end > len(content):
            remarks.count("message cut short at the end, or garbled", f"byte {place}")
            end = place + 2
        elif sums.of(place + 2, end - 2) == content[end - 2 : end]:
            yield place, content[place:end]
        else:
            remarks.count("message with a wrong checksum", f"byte {place}")
            end = place + 2
        place = content.find(_SYNC, end)


class _Sums:
    """Fletcher's sums, as u-blox has them, of any stretch that may be a message, each in the same short time.

    What begins like a message may be as long as one can be at every place: summed one by one, these would cost the
    square of a file. The sums of a stretch follow from those of all bytes before its beginning and its end.
    """

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._start = self._stop = 0
        self._first = self._second = np.zeros(1, np.uint8)

    def of(self, start: int, stop: int) -> bytes:
        """Return the two bytes for the stretch between two places; it begins no earlier than the one before it."""
        if not self._start <= start <= stop <= self._stop:
            self._start = start
            self._stop = min(len(self._content), start + _SUMMED_BYTES + _MAX_PAYLOAD + _HEAD_BYTES)
            values = np.frombuffer(self._content, np.uint8, self._stop - start, start)
            # modulo 256 throughout, as the sums are
            self._first = np.concatenate([np.zeros(1, np.uint8), np.cumsum(values, dtype=np.uint8)])
            self._second = np.concatenate([np.zeros(1, np.uint8), np.cumsum(self._first[1:], dtype=np.uint8)])
        a, b = start - self._start, stop - self._start
        before = int(self._first[a])
        second = int(self._second[b]) - int(self._second[a]) - (b - a) * before
        return bytes([(int(self._first[b]) - before) & 0xFF, second & 0xFF])


def _parser() -> Any:
    """Return a function from a frame to a message, None where its content is not as it should be."""
    try:
        from pyubx2 import UBXReader
        from pyubx2.exceptions import UBXMessageError, UBXParseError, UBXStreamError, UBXTypeError
    except ImportError as error:
        raise MissingExtraError("reading u-blox logs", "logs") from error

    def parse(frame: bytes) -> Any:
        try:
            message = UBXReader.parse(frame)
            return message if isinstance(message.iTOW, int) else None
        except (UBXMessageError, UBXParseError, UBXStreamError, UBXTypeError):
            return None
        except (ValueError, TypeError, LookupError, AttributeError):
            return None

    return parse


def _fix(message: Any, fine: dict[tuple[int, int], Any], options: LogOptions, remarks: ReadingNotes) -> LogFix | None:
    """Return the fix of one NAV-PVT, None where it is not usable, which is counted."""
    if not (message.validDate and message.validTime):
        remarks.count("NAV-PVT without a valid date and time")
        return None
    if not message.gnssFixOk or message.fixType not in (3, 4) or getattr(message, "invalidLlh", False):
        remarks.count("NAV-PVT without a 3-D fix")
        return None
    try:
        day = day_number(message.year, message.month, message.day)
    except ValueError:
        remarks.count("NAV-PVT without a valid date and time")
        return None
    # nano may be negative: the second is rounded to the nearest, not down
    second = 3600.0 * message.hour + 60 * message.min + message.second + 1e-9 * message.nano
    if second < 0.0:
        day, second = day - 1, second + DAY_S
    lat, lon, height = message.lat, message.lon, message.height * _PER_MM
    horizontal, up = message.hAcc * _PER_MM / math.sqrt(2.0), message.vAcc * _PER_MM
    sigma = usable_sigma(horizontal, horizontal, up)
    precise = fine.get((_HPPOSLLH[1], message.iTOW))
    if precise is not None and not precise.invalidLlh:
        lat, lon, height = precise.lat, precise.lon, precise.height * _PER_MM
        horizontal = precise.hAcc * _PER_MM / math.sqrt(2.0)
        sigma = usable_sigma(horizontal, horizontal, precise.vAcc * _PER_MM)
    quality = (FixQuality.DGPS if message.diffSoln else FixQuality.SINGLE, FixQuality.FLOAT, FixQuality.FIX)
    fix = LogFix(
        day=day,
        second=second,
        scale=TimeScale.UTC,
        lat_deg=lat,
        lon_deg=lon,
        height_m=height,
        quality=quality[min(message.carrSoln, 2)],
        sigma_enu_m=sigma,
    )
    if options.base_deg_m is not None:
        remarks.used.add("base_deg_m")
        return _from_base(fix, fine.get((_RELPOSNED[1], message.iTOW)), options.base_deg_m, remarks)
    if not plausible(fix):
        remarks.count("NAV-PVT that is no place on Earth")
        return None
    return fix


def _from_base(
    fix: LogFix, relative: Any, base_deg_m: tuple[float, float, float], remarks: ReadingNotes
) -> LogFix | None:
    """Return the fix moved to where NAV-RELPOSNED sees it from the base; its lengths are cm, sigmas mm."""
    if relative is None or not relative.relPosValid or not relative.gnssFixOK:
        remarks.count("NAV-PVT without a valid NAV-RELPOSNED of the same epoch")
        return None
    enu = _PER_CM * np.array([relative.relPosE, relative.relPosN, -relative.relPosD])
    lat, lon, height = (float(v) for v in geodetic_from_ecef(ecef_from_enu(enu, base_deg_m)))
    sigma = usable_sigma(*(_PER_MM * float(s) for s in (relative.accE, relative.accN, relative.accD)))
    return LogFix(
        day=fix.day,
        second=fix.second,
        scale=fix.scale,
        lat_deg=lat,
        lon_deg=lon,
        height_m=height,
        quality=(FixQuality.DGPS, FixQuality.FLOAT, FixQuality.FIX)[min(relative.carrSoln, 2)],
        sigma_enu_m=sigma,
    )
