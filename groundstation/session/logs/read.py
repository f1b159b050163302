"""Any log of positions, recognised by its content: read, sorted by time, implausible entries left out and counted."""

import bisect
import datetime
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import LogError, os_words
from groundstation.geometry.geodesy import ecef_from_geodetic
from groundstation.session.logs.dataflash import read_dataflash
from groundstation.session.logs.fixes import DEFAULT_SIGMA_M, FixQuality, LogFix, LogOptions, ReadingNotes, check_count
from groundstation.session.logs.gps_time import DAYS_OF_ERA, date_of, gps_from_civil, utc_day
from groundstation.session.logs.nmea import is_nmea, read_nmea
from groundstation.session.logs.positions_table import read_positions
from groundstation.session.logs.rtklib import read_pos
from groundstation.session.logs.text_lines import check_file
from groundstation.session.logs.tlog import read_tlog
from groundstation.session.logs.ubx import read_ubx
from groundstation.session.logs.ulog import read_ulog

Reader = Callable[[Path, LogOptions, ReadingNotes], list[LogFix]]
LOG_SUFFIXES: dict[str, Reader] = {
    ".nmea": read_nmea,
    ".pos": read_pos,
    ".ulg": read_ulog,
    ".bin": read_dataflash,
    ".tlog": read_tlog,
    ".ubx": read_ubx,
    ".csv": read_positions,
}
_HEAD_BYTES = 65_536
# one flight field: a position farther than this from the middle of the log is not plausible
MAX_EXTENT_M = 50_000.0
_FIRST_YEAR = 2000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GnssLog:
    """The fixes of a log in order of time.

    ``gps_s`` (n,) rising, s of GPS time; ``lat_deg``, ``lon_deg``, ``height_m`` (n,), ellipsoid; ``sigma_enu_m`` (n, 3)
    one sigma, the log's or that of the fix's quality; ``covariance_en_m2`` (n,); ``remarks`` one line for each reason
    why something was left out or taken for granted.
    """

    name: str
    gps_s: FloatArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    height_m: FloatArray
    sigma_enu_m: FloatArray
    covariance_en_m2: FloatArray
    quality: tuple[FixQuality, ...]
    remarks: tuple[str, ...]


def read_log(path: Path, options: LogOptions | None = None) -> GnssLog:
    """Read a log of any known format.

    Raises `LogError` (or `MissingExtraError`) in one line: a missing file, an unknown format, no usable content,
    or missing information that the user has to give.
    """
    options = options or LogOptions()
    check_file(path)
    reader = _reader(path)
    remarks = ReadingNotes(path.name)
    fixes = reader(path, options, remarks)
    check_count(path, fixes)
    if not fixes:
        raise LogError(path.name, got=f"no usable position ({remarks.short()})", wanted="positions with time and fix")
    fixes = _in_era(path, fixes, options, remarks)
    remarks.note_unused(options)
    return _log(path, fixes, remarks)


def _reader(path: Path) -> Reader:
    """Return what reads a file, by its first bytes; a log may begin with another program's rest."""
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
    except OSError as fault:
        raise LogError(str(path), got=os_words(fault), wanted="a file that can be read") from fault
    if head.startswith(b"ULog\x01\x12\x35"):
        return read_ulog
    if head.startswith(b"\xa3\x95"):
        return read_dataflash
    suffix = path.suffix.lower()
    if suffix not in (".tlog", ".csv", ".pos", ".ulg"):
        if b"\xb5\x62\x01" in head and suffix != ".nmea":
            return read_ubx
        if is_nmea(head):
            return read_nmea
        if head.lstrip().startswith(b"%"):
            return read_pos
    if suffix in LOG_SUFFIXES:
        return LOG_SUFFIXES[suffix]
    wanted = "NMEA, RTKLIB .pos, PX4 .ulg, ArduPilot .bin or .tlog, u-blox .ubx, or .csv"
    raise LogError(str(path), got="a log of no format that is known", wanted=wanted)


def _in_era(path: Path, fixes: list[LogFix], options: LogOptions, remarks: ReadingNotes) -> list[LogFix]:
    """Move a log whose receiver counts its weeks from the wrong 1024 to the user's date; refuse another date."""
    first = fixes[0]
    if options.date is not None:
        remarks.used.add("date")
        wanted = (options.date - datetime.date(1980, 1, 6)).days
        # in the night a log may have two dates, and either is its own
        days = sorted(utc_day(gps_from_civil(fix.day, fix.second, fix.scale)) for fix in (first, fixes[-1]))
        eras = round((wanted - days[0]) / DAYS_OF_ERA)
        if not days[0] <= wanted - eras * DAYS_OF_ERA <= days[1]:
            got = "positions of " + " to ".join(dict.fromkeys(date_of(day).isoformat() for day in days))
            raise LogError(path.name, got=got, wanted=f"{options.date.isoformat()}, the date given for it")
        if eras:
            remarks.note(f"dated {date_of(first.day).isoformat()}: moved by {eras} × 1024 weeks to the date given")
            return [replace(fix, day=fix.day + eras * DAYS_OF_ERA) for fix in fixes]
    elif date_of(first.day).year < _FIRST_YEAR:
        wanted_text = "its true date: date in [dgps] of session.toml, or --date (GPS weeks start again each 1024)"
        raise LogError(path.name, got=f"a log of {date_of(first.day).isoformat()}", wanted=wanted_text)
    return fixes


def _log(path: Path, fixes: list[LogFix], remarks: ReadingNotes) -> GnssLog:
    """Return the fixes as arrays, without those that stand at a wrong time or far from all others."""
    gps_s = np.array([gps_from_civil(f.day, f.second, f.scale) for f in fixes])
    kept = rising(gps_s)
    if len(kept) < len(fixes):
        gone = next(k for k, i in enumerate([*kept, -1]) if k != i)
        remarks.count("position whose time does not grow", f"position {gone + 1}", len(fixes) - len(kept))
    places = np.array([(fixes[k].lat_deg, fixes[k].lon_deg, fixes[k].height_m) for k in kept])
    ecef = ecef_from_geodetic(*places.T)
    far = np.linalg.norm(ecef - np.median(ecef, axis=0), axis=1) > MAX_EXTENT_M
    if np.any(far):
        remarks.count("position far from all others", f"position {kept[int(np.argmax(far))] + 1}", int(far.sum()))
    if np.all(far):
        raise LogError(path.name, got="positions all over the Earth", wanted=f"one flight, within {MAX_EXTENT_M:g} m")
    chosen = [fixes[k] for k, out in zip(kept, far, strict=True) if not out]
    _note_sigmas(chosen, remarks)
    return GnssLog(
        name=path.name,
        gps_s=gps_s[kept][~far],
        lat_deg=places[~far, 0],
        lon_deg=places[~far, 1],
        height_m=places[~far, 2],
        sigma_enu_m=np.array([f.sigma_enu_m or DEFAULT_SIGMA_M[f.quality] for f in chosen]),
        covariance_en_m2=np.array([f.covariance_en_m2 for f in chosen]),
        quality=tuple(f.quality for f in chosen),
        remarks=remarks.lines(),
    )


def _note_sigmas(fixes: list[LogFix], remarks: ReadingNotes) -> None:
    """Note where sigmas come from if not from the log."""
    without = [f.quality for f in fixes if f.sigma_enu_m is None]
    if without:
        kinds = ", ".join(f"{q} {DEFAULT_SIGMA_M[q][0]:g}/{DEFAULT_SIGMA_M[q][2]:g} m" for q in sorted(set(without)))
        remarks.note(f"no sigmas for {len(without)} of {len(fixes)} positions: level/up by quality, {kinds}")


def rising(t_s: FloatArray) -> list[int]:
    """Return the longest choice of indices whose times rise: one garbled time ahead does not cost all that follow."""
    tails: list[float] = []
    tail_index: list[int] = []
    before = [-1] * len(t_s)
    for k, t in enumerate(t_s.tolist()):
        place = bisect.bisect_left(tails, t)
        before[k] = tail_index[place - 1] if place else -1
        # of equal times the first stays
        if place < len(tails) and tails[place] == t:
            continue
        tails[place : place + 1] = [t]
        tail_index[place : place + 1] = [k]
    chosen = []
    k = tail_index[-1] if tail_index else -1
    while k >= 0:
        chosen.append(k)
        k = before[k]
    return chosen[::-1]
