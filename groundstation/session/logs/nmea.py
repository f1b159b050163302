"""NMEA 0183: positions of GGA, dates of RMC and ZDA, sigmas of GST, decoded by pynmeagps.

A line counts only with its checksum: pynmeagps returns None for a line without one, which a truncated line has lost.
"""

import re
from dataclasses import dataclass, field
from functools import reduce
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
from groundstation.session.logs.gps_time import DAY_S, TimeScale, date_of, day_number
from groundstation.session.logs.text_lines import text_lines

_QUALITY = {
    1: FixQuality.SINGLE,
    2: FixQuality.DGPS,
    3: FixQuality.PPS,
    4: FixQuality.FIX,
    5: FixQuality.FLOAT,
    7: FixQuality.UNKNOWN,
    8: FixQuality.SIMULATED,
}
_SENTENCE = re.compile(r"\$([A-Z]{2})(GGA|RMC|ZDA|GST),[\x20-\x7e]*?\*[0-9A-Fa-f]{2}\s*", re.ASCII)
_ANY = re.compile(r"[$!]([A-Z0-9]{2,16}),", re.ASCII)
_TIME = re.compile(r"(\d{2})(\d{2})(\d{2}(?:\.\d*)?)", re.ASCII)
_DEGREE_M = 111_320.0
_FINE_DECIMALS = 5
_MAX_GST = 2_000_000


@dataclass(slots=True)
class GgaFix:
    """A GGA that waits for its date: how many dates of RMC and of ZDA stood before it, its second, the rest."""

    dates_before: tuple[int, int]
    second: float
    lat_deg: float
    lon_deg: float
    height_m: float
    quality: FixQuality


@dataclass(slots=True)
class ParsedSentences:
    """Content of the lines: dates as day and second of it, sigmas by second of the day."""

    fixes: list[GgaFix] = field(default_factory=list)
    dates: list[tuple[int, float]] = field(default_factory=list)
    zda_dates: list[tuple[int, float]] = field(default_factory=list)
    sigmas: dict[tuple[int, float], tuple[float, float, float]] = field(default_factory=dict)
    separations: set[float] = field(default_factory=set)
    decimals: int = 0


def read_nmea(path: Path, options: LogOptions, remarks: ReadingNotes) -> list[LogFix]:
    """Read a log of NMEA sentences. Raises `LogError` where positions have no date or heights no reference."""
    sentences = NmeaSentences(Heights(path, options), remarks)
    found = sentences.found
    for number, line, _ in text_lines(path, remarks):
        sentences.take(line, f"line {number}")
        if len(found.fixes) % 10_000 == 0:
            check_count(path, found.fixes)
    _say(found, remarks, options.geoid_separation_m is not None)
    return dated(path.name, found, options, remarks)


class NmeaSentences:
    """Sorts lines into ``found``, and counts in the notes the text that is not a usable sentence."""

    def __init__(self, heights: Heights, remarks: ReadingNotes) -> None:
        self.found = ParsedSentences()
        self._heights, self._remarks = heights, remarks
        self._parse = _parser()

    def take(self, line: str, where: str) -> None:
        """Take one line. Raises `LogError` for a position whose height has no reference."""
        # binary messages may precede a sentence in the same line
        start = line.rfind("$")
        sentence = line[max(start, 0) :]
        if start < 0 or not _SENTENCE.fullmatch(sentence):
            _count_other(line, sentence, self._remarks, where)
            return
        if reduce(lambda a, b: a ^ b, sentence[1 : sentence.rindex("*")].encode(), 0) != int(
            sentence.split("*")[-1], 16
        ):
            self._remarks.count("sentence with a wrong checksum", where)
            return
        message = self._parse(sentence.strip())
        if message is None:
            self._remarks.count("sentence that pynmeagps does not understand", where)
            return
        _take(message, sentence.split("*")[0].split(","), self.found, self._heights, self._remarks, where)


def _parser() -> Any:
    """Return a function from a sentence to a message, None if it is not one."""
    try:
        from pynmeagps import NMEAReader
        from pynmeagps.exceptions import NMEAMessageError, NMEAParseError, NMEAStreamError, NMEATypeError
    except ImportError as error:
        raise MissingExtraError("reading NMEA", "logs") from error

    def parse(sentence: str) -> Any:
        try:
            return NMEAReader.parse(sentence)
        except (NMEAMessageError, NMEAParseError, NMEAStreamError, NMEATypeError, ValueError, TypeError, LookupError):
            return None

    return parse


def _count_other(line: str, sentence: str, remarks: ReadingNotes, where: str) -> None:
    """Count text that is not a sentence read here: other sentences are expected, the rest is not."""
    if not line.strip() or (
        _ANY.match(sentence) and "*" in sentence and sentence[3:6] not in ("GGA", "RMC", "ZDA", "GST")
    ):
        return
    if sentence[3:6] in ("GGA", "RMC", "ZDA", "GST"):
        remarks.count("sentence cut short, garbled or without a checksum", where)
    elif not _ANY.match(sentence):
        remarks.count("line that is no NMEA sentence", where)


def _take(
    message: Any, cells: list[str], found: ParsedSentences, heights: Heights, remarks: ReadingNotes, where: str
) -> None:
    """Sort one decoded sentence in."""
    kind = cells[0][3:]
    second = _second(cells[1]) if len(cells) > 1 else None
    if second is None:
        if kind == "GGA":
            remarks.count("GGA without a time", where)
    elif kind == "GGA":
        _take_gga(message, cells, second, found, heights, remarks, where)
    elif kind == "RMC":
        if getattr(message, "status", "") == "A" and (day := _day(getattr(message, "date", None))) is not None:
            found.dates.append((day, second))
    elif kind == "ZDA":
        try:
            found.zda_dates.append((day_number(int(message.year), int(message.month), int(message.day)), second))
        except (ValueError, TypeError, AttributeError):
            remarks.count("ZDA without a date", where)
    else:
        sigma = _gst(message)
        if sigma is not None and len(found.sigmas) < _MAX_GST:
            # GST follows or precedes the GGA of its epoch: the same second near the same place in the log
            found.sigmas[(len(found.fixes) // 1000, second)] = sigma


def _take_gga(
    message: Any,
    cells: list[str],
    second: float,
    found: ParsedSentences,
    heights: Heights,
    remarks: ReadingNotes,
    where: str,
) -> None:
    # a sentence with too few fields is a message with too few of its values
    if not all(hasattr(message, name) for name in ("quality", "lat", "lon", "alt", "sep")):
        remarks.count("GGA without a whole position", where)
        return
    if message.quality in (0, 6) or message.quality not in _QUALITY:
        words = {0: "GGA without a fix", 6: "GGA of dead reckoning"}
        remarks.count(words.get(message.quality, "GGA of an unknown quality"), where)
        return
    numbers = [message.lat, message.lon, message.alt]
    if not all(isinstance(n, int | float) and abs(n) < 1e6 for n in numbers):
        remarks.count("GGA without a whole position", where)
        return
    separation = message.sep if isinstance(message.sep, int | float) and abs(message.sep) < 1e3 else None
    if separation is not None and len(found.separations) < 3:
        found.separations.add(float(separation))
    found.decimals = max(found.decimals, len(cells[2].partition(".")[2]))
    height = heights.ellipsoid(float(message.alt), separation)
    found.fixes.append(
        GgaFix(
            dates_before=(len(found.dates), len(found.zda_dates)),
            second=second,
            lat_deg=float(message.lat),
            lon_deg=float(message.lon),
            height_m=height,
            quality=_QUALITY[message.quality],
        )
    )


def _say(found: ParsedSentences, remarks: ReadingNotes, given: bool) -> None:
    """Note facts about the whole log for the user."""
    if found.fixes and found.decimals < _FINE_DECIMALS:
        step = _DEGREE_M / 60 * 10.0**-found.decimals
        remarks.note(f"positions are written in steps of {step:.2g} m: minutes have {found.decimals} decimals")
    if found.fixes and found.separations == {0.0} and not given:
        remarks.note("the geoid separation is 0 m in every sentence: its heights are taken as ellipsoid heights")


def dated(name: str, found: ParsedSentences, options: LogOptions, remarks: ReadingNotes) -> list[LogFix]:
    """Give each position its date: that of the RMC (or ZDA) next to it, or counted on from the user's."""
    if not found.fixes:
        return []
    # a ZDA may come from a clock that has no fix yet
    which, dates = (0, found.dates) if found.dates else (1, found.zda_dates)
    if not dates and options.date is None:
        wanted = "the UTC date of its first position: date in [dgps] of session.toml, or --date"
        raise LogError(name, got="positions without a date (no RMC or ZDA)", wanted=wanted)
    fixes = []
    day, before = 0, 0.0
    if not dates and options.date is not None:
        day, before = day_number(options.date.year, options.date.month, options.date.day), found.fixes[0].second
    for count, fix in enumerate(found.fixes):
        if dates:
            day, before = _nearest(dates, fix.dates_before[which], fix.second)
        # the date is that of `before`; midnight may be between the two
        away = fix.second - before
        day, before = day + (-1 if away > DAY_S / 2 else 1 if away < -DAY_S / 2 else 0), fix.second
        sigma = found.sigmas.get((count // 1000, fix.second)) or found.sigmas.get(((count + 1) // 1000, fix.second))
        made = LogFix(
            day=day,
            second=fix.second,
            scale=TimeScale.UTC,
            lat_deg=fix.lat_deg,
            lon_deg=fix.lon_deg,
            height_m=fix.height_m,
            quality=fix.quality,
            sigma_enu_m=sigma,
        )
        if plausible(made):
            fixes.append(made)
        else:
            remarks.count("GGA that is no place on Earth")
    if not dates:
        remarks.note(f"dates counted on from {date_of(fixes[0].day if fixes else 0).isoformat()}")
    return fixes


def _nearest(dates: list[tuple[int, float]], count: int, second: float) -> tuple[int, float]:
    """Return the last date before a place in the log or the first after it, whichever is nearer on the clock."""
    near = dates[max(count - 1, 0) : count + 1]
    return min(near, key=lambda d: min(abs(d[1] - second), DAY_S - abs(d[1] - second)))


def _second(text: str) -> float | None:
    """Return the second of the day of hhmmss.ss; a leap second is hh:mm:60."""
    match = _TIME.fullmatch(text)
    if match is None or int(match[1]) > 23 or int(match[2]) > 59 or float(match[3]) >= 61:
        return None
    return 3600 * int(match[1]) + 60 * int(match[2]) + float(match[3])


def _day(date: Any) -> int | None:
    """Return the day of a date, whose year RMC writes with two digits."""
    try:
        return day_number(date.year, date.month, date.day)
    except (AttributeError, ValueError, TypeError):
        return None


def _gst(message: Any) -> tuple[float, float, float] | None:
    """Return sigmas east, north, up of a GST."""
    try:
        return usable_sigma(float(message.stdLong), float(message.stdLat), float(message.stdAlt))
    except (AttributeError, ValueError, TypeError):
        return None


def is_nmea(head: bytes) -> bool:
    """Return whether the first bytes of a file hold the beginning of a sentence."""
    return re.search(rb"\$[A-Z]{2}(GGA|RMC|ZDA|GSA|GSV|VTG|GLL|GST|TXT),", head) is not None
