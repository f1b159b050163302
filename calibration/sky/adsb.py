"""Positions of airliners as receivers note them: JSON of dump1090 and readsb, or SBS (BaseStation) lines.

JSON: one object a line, either an aircraft with its time ("now", readsb's network port) or a whole aircraft.json ("now"
and "aircraft"). SBS: the lines MSG,2 and MSG,3 of port 30003, dates and times in UTC. Heights: "alt_geom" is above the
ellipsoid; "alt_baro" and those of SBS are pressure altitudes.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TextIO

from groundstation.errors import InputError, os_words

FOOT_M = 0.3048
# no airliner flies higher; the longest line of a receiver with a thousand aircraft is 0.5 MB
_HIGHEST_M, _LOWEST_M = 20_000.0, -500.0
_MOST_LINE = 4_000_000
MOST_REPORTS = 2_000_000
# a position that the receiver has had for so long is no news
_OLDEST_S = 60.0
_SBS_FIELDS = 22


@dataclass(frozen=True, slots=True, kw_only=True)
class AdsbReport:
    """One position of one aircraft: its ICAO address, the receiver's Unix time, s, and where.

    ``height_m`` is above the ellipsoid where ``geometric``, else the pressure altitude.
    """

    aircraft: str
    t_s: float
    lat_deg: float
    lon_deg: float
    height_m: float
    geometric: bool


def read_adsb(path: Path) -> dict[str, tuple[AdsbReport, ...]]:
    """Return the reports of a file by aircraft, in order of time, each position once; raises `InputError`.

    Lines of other messages, and lines cut off, are passed over; a file without any position is refused.
    """
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            found = by_aircraft(reports_of(_lines(file, path)))
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a file of a receiver's lines") from fault
    if not found:
        wanted = "lines of dump1090 or readsb (JSON), or of SBS (MSG,3 with latitude and longitude)"
        raise InputError(str(path), got="no aircraft's position", wanted=wanted)
    return found


def _lines(file: TextIO, path: Path) -> Iterator[str]:
    # no more of a line is read than it may have: a file may have no line end
    for line in iter(lambda: file.readline(_MOST_LINE + 1), ""):
        if len(line) > _MOST_LINE:
            raise InputError(str(path), got=f"a line of more than {_MOST_LINE} characters", wanted="a receiver's lines")
        yield line


def by_aircraft(reports: Iterable[AdsbReport]) -> dict[str, tuple[AdsbReport, ...]]:
    """Return reports by aircraft, in order of time; of one position repeated the first."""
    found: dict[str, dict[tuple[float, float], AdsbReport]] = {}
    for count, report in enumerate(reports):
        if count == MOST_REPORTS:
            raise InputError("ADS-B", got="one more position", wanted=f"at most {MOST_REPORTS}")
        own = found.setdefault(report.aircraft, {})
        place = (report.lat_deg, report.lon_deg)
        if place not in own or report.t_s < own[place].t_s:
            own[place] = report
    return {name: tuple(sorted(own.values(), key=lambda r: r.t_s)) for name, own in found.items()}


def reports_of(lines: Iterable[str]) -> Iterator[AdsbReport]:
    """Yield the positions in a receiver's lines."""
    for line in lines:
        text = line.strip()
        if text.startswith("{"):
            yield from _of_json(text)
        elif text.startswith("MSG,"):
            report = _of_sbs(text.split(","))
            if report is not None:
                yield report


def _of_json(text: str) -> Iterator[AdsbReport]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        return
    if not isinstance(document, dict):
        return
    listed = document.get("aircraft", [document])
    for entry in listed if isinstance(listed, list) else ():
        if isinstance(entry, dict):
            report = _of_entry(entry, entry.get("now", document.get("now")))
            if report is not None:
                yield report


def _of_entry(entry: Mapping[str, object], now: object) -> AdsbReport | None:
    seen = _number(entry.get("seen_pos", 0.0))
    t_s, lat, lon = _number(now), _number(entry.get("lat")), _number(entry.get("lon"))
    geometric = _number(entry.get("alt_geom"))
    height = geometric if geometric is not None else _number(entry.get("alt_baro", entry.get("altitude")))
    if t_s is None or seen is None or not 0.0 <= seen <= _OLDEST_S:
        return None
    return _report(str(entry.get("hex", "")), t_s - seen, lat, lon, height, geometric is not None)


def _of_sbs(fields: list[str]) -> AdsbReport | None:
    if len(fields) < _SBS_FIELDS or fields[1] not in ("2", "3"):
        return None
    try:
        when = datetime.strptime(f"{fields[6]} {fields[7]}", "%Y/%m/%d %H:%M:%S.%f").replace(tzinfo=UTC)
        height, lat, lon = (float(fields[k]) for k in (11, 14, 15))
    except ValueError:
        return None
    return _report(fields[4], when.timestamp(), lat, lon, height, geometric=False)


def as_json(report: AdsbReport, t_s: float | None = None) -> str:
    """Return a report as a line of JSON that `read_adsb` reads; ``t_s`` in place of its time."""
    height = "alt_geom" if report.geometric else "alt_baro"
    row = {
        "now": round(report.t_s if t_s is None else t_s, 3),
        "hex": report.aircraft,
        "lat": report.lat_deg,
        "lon": report.lon_deg,
        height: round(report.height_m / FOOT_M, 1),
    }
    return json.dumps(row)


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        # an integer of hundreds of digits
        return None
    return number if math.isfinite(number) else None


def _report(
    name: str, t_s: float, lat: float | None, lon: float | None, height_ft: float | None, geometric: bool
) -> AdsbReport | None:
    """Return a report, or None for one that lacks something or cannot be."""
    aircraft = name.strip().lower()
    if lat is None or lon is None or height_ft is None or not aircraft.isalnum() or len(aircraft) > 8:
        return None
    height = FOOT_M * height_ft
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0 and _LOWEST_M < height < _HIGHEST_M):
        return None
    return AdsbReport(aircraft=aircraft, t_s=t_s, lat_deg=lat, lon_deg=lon, height_m=height, geometric=geometric)
