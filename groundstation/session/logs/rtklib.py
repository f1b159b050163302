"""RTKLIB's solution files (.pos) in their variants: a header that names the columns, and rows that must fit it.

Layout after the manual of RTKLIB 2.4.2, appendix B.1, held against files that rnx2rtkp 2.4.3 wrote.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.errors import LogError
from groundstation.geometry.geodesy import ecef_from_enu, enu_axes, geodetic_from_ecef
from groundstation.session.logs.fixes import (
    MAX_SIGMA_M,
    FixQuality,
    Heights,
    LogFix,
    LogOptions,
    ReadingNotes,
    check_count,
    plausible,
    usable_sigma,
)
from groundstation.session.logs.gps_time import DAY_S, WEEK_S, TimeScale, day_number
from groundstation.session.logs.rtklib_header import PosLayout, layout_of_row, read_header_line
from groundstation.session.logs.text_lines import text_lines

_QUALITY = {
    1: FixQuality.FIX,
    2: FixQuality.FLOAT,
    3: FixQuality.SBAS,
    4: FixQuality.DGPS,
    5: FixQuality.SINGLE,
    6: FixQuality.PPP,
}
_SEPARATOR = re.compile(r"[ ]*[,;\t][ ]*|[ ]+")
# possessive: of a thousand digits no other division is tried
_NUMBER = re.compile(r"[+-]?(\d++(?:\.\d*+)?|\.\d++)", re.ASCII)
_DATE = re.compile(r"(\d{4})/(\d{1,2})/(\d{1,2})", re.ASCII)
_CLOCK = re.compile(r"(\d{1,2}):(\d{2}):(\d{2}(?:\.\d*)?)", re.ASCII)
_MAX_BASELINE_M = 2e7
_EAST_OF_UTC_S = {"JST": 9 * 3600.0}
_ANGLE = re.compile(r"([+-]?)(\d{1,3}):(\d{1,2}):(\d{1,2}(?:\.\d*)?)", re.ASCII)


class _BadRowError(Exception):
    """A row that does not fit the header; its text is the reason that is counted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    """One row's numbers by column name."""

    day: int
    second: float
    values: dict[str, float]


def read_pos(path: Path, options: LogOptions, remarks: ReadingNotes) -> list[LogFix]:
    """Read a solution file. Raises `LogError` where its header is not supported, or it has no row."""
    layout = PosLayout()
    fixes: list[LogFix] = []
    reader = _PosReader(path, options, remarks)
    rows = 0
    for number, line, whole in text_lines(path, remarks):
        if not line.strip():
            continue
        if line.lstrip().startswith("%"):
            layout = read_header_line(line, layout, f"{path.name}: line {number}")
            continue
        rows += 1
        try:
            if not whole and layout.columns:
                _check_last(line, layout)
            fixes.append(reader.fix(line, layout, f"{path.name}: line {number}"))
        except _BadRowError as fault:
            remarks.count(str(fault), f"line {number}")
        if len(fixes) % 10_000 == 0:
            check_count(path, fixes)
    if rows and not layout.columns:
        remarks.note("no header: taken as GPS time, degrees (or ECEF) and ellipsoid heights, RTKLIB's defaults")
    return fixes


def _check_last(line: str, layout: PosLayout) -> None:
    """Refuse a last line that may have lost digits of a number that is used."""
    if len(_tokens(line)) < layout.row_tokens or layout.columns[-1] in _USED:
        raise _BadRowError("row cut short")


_USED = frozenset({"height", "z-ecef", "u-baseline"})


class _PosReader:
    """Turns rows into fixes."""

    def __init__(self, path: Path, options: LogOptions, remarks: ReadingNotes) -> None:
        self._path = path
        self._options = options
        self._remarks = remarks
        self._heights = Heights(path, options)
        self._guessed: PosLayout | None = None

    def fix(self, line: str, layout: PosLayout, where: str) -> LogFix:
        """Return the fix of one row; raises `_BadRowError` for a row that does not fit."""
        tokens = _tokens(line)
        if not layout.columns:
            self._guessed = self._guessed or layout_of_row(tokens)
            if self._guessed is None:
                raise _BadRowError("row that is no default RTKLIB row, without a header")
            layout = self._guessed
        row = _row(tokens, layout)
        quality = self._quality(row)
        lat, lon, height = self._place(row.values, layout, where)
        sigma, covariance = _sigmas(row.values, lat, lon)
        day, second = row.day, row.second - _EAST_OF_UTC_S.get(layout.time_system, 0.0)
        if second < 0.0:
            day, second = day - 1, second + DAY_S
        fix = LogFix(
            day=day,
            second=second,
            scale=TimeScale.GPS if layout.time_system == "GPST" else TimeScale.UTC,
            lat_deg=lat,
            lon_deg=lon,
            height_m=height,
            quality=quality,
            sigma_enu_m=sigma,
            covariance_en_m2=covariance,
        )
        if not plausible(fix):
            raise _BadRowError("row that is no place on Earth")
        return fix

    def _quality(self, row: _Row) -> FixQuality:
        if "Q" not in row.values:
            return FixQuality.UNKNOWN
        quality = _QUALITY.get(int(row.values["Q"])) if row.values["Q"].is_integer() else None
        if quality is None:
            raise _BadRowError("row without a solution (Q)" if row.values["Q"] == 0 else "row with an unknown Q")
        return quality

    def _place(self, values: dict[str, float], layout: PosLayout, where: str) -> tuple[float, float, float]:
        """Return latitude, longitude in degrees and ellipsoid height in m."""
        # the header's first columns are the place; a damaged one may have the name of another kind further on
        first = layout.columns[0]
        if first == "latitude":
            height = values["height"]
            if layout.geodetic:
                height = self._heights.ellipsoid(height, None)
            return values["latitude"], values["longitude"], height
        if first == "x-ecef":
            ecef = np.array([values[f"{axis}-ecef"] for axis in "xyz"])
        else:
            base = layout.base_deg_m or self._options.base_deg_m
            if base is None:
                wanted = "a '% ref pos' line, or the base's place: base in [dgps] of session.toml, or --base"
                raise LogError(where, got="a baseline from a base at an unknown place", wanted=wanted)
            if layout.base_deg_m is None:
                self._remarks.used.add("base_deg_m")
            baseline = np.array([values[f"{axis}-baseline"] for axis in "enu"])
            # farther than any two places on Earth; products of far larger numbers are not finite
            if not np.all(np.abs(baseline) < _MAX_BASELINE_M):
                raise _BadRowError("row that is no place on Earth")
            ecef = ecef_from_enu(baseline, base)
        # unlike a norm by squares, hypot does not overflow
        if not 6.2e6 < math.hypot(*ecef.tolist()) < 6.6e6:
            raise _BadRowError("row that is no place on Earth")
        place = geodetic_from_ecef(ecef)
        return float(place[0]), float(place[1]), float(place[2])


def _tokens(line: str) -> list[str]:
    """Split a row by its separators; an empty cell stays, so that nothing moves into its place."""
    return _SEPARATOR.split(line.strip(" \r\n"))


def _row(tokens: list[str], layout: PosLayout) -> _Row:
    """Return the numbers by name; each row must have as many as the header has columns."""
    if len(tokens) != layout.row_tokens:
        raise _BadRowError("row cut short" if len(tokens) < layout.row_tokens else "row with too many numbers")
    day, second = _time(tokens[0], tokens[1])
    values: dict[str, float] = {}
    rest: Iterator[str] = iter(tokens[2:])
    for name, parts in zip(layout.columns, layout.parts, strict=True):
        words = [next(rest) for _ in range(parts)]
        values[name] = _angle(words) if parts == 3 else _number(words[0])
    return _Row(day=day, second=second, values=values)


def _number(text: str) -> float:
    """Return a plain decimal number, or degrees:minutes:seconds."""
    if _NUMBER.fullmatch(text):
        return float(text)
    match = _ANGLE.fullmatch(text)
    if match is None:
        raise _BadRowError("row with a cell that is no number")
    return _angle([match[1] + match[2], match[3], match[4]])


def _angle(words: list[str]) -> float:
    """Return degrees of degrees, minutes and seconds; the sign of -0 counts."""
    if not all(_NUMBER.fullmatch(word) for word in words):
        raise _BadRowError("row with a cell that is no number")
    degrees, minutes, seconds = (float(word) for word in words)
    if not (0 <= minutes < 60 and 0 <= seconds < 60.00001):
        raise _BadRowError("row with 60 or more minutes or seconds")
    return math.copysign(abs(degrees) + minutes / 60 + seconds / 3600, degrees)


def _time(first: str, second: str) -> tuple[int, float]:
    """Return day and second of yyyy/mm/dd hh:mm:ss, or of a GPS week and seconds of it."""
    date, clock = _DATE.fullmatch(first), _CLOCK.fullmatch(second)
    if date and clock:
        hour, minute, seconds = int(clock[1]), int(clock[2]), float(clock[3])
        if hour < 24 and minute < 60 and seconds < 61:
            try:
                return day_number(int(date[1]), int(date[2]), int(date[3])), 3600 * hour + 60 * minute + seconds
            except ValueError:
                pass
    elif first.isascii() and first.isdigit() and len(first) <= 5 and _NUMBER.fullmatch(second):
        of_week = float(second)
        if 0 <= of_week < WEEK_S:
            day = int(of_week // DAY_S)
            return 7 * int(first) + day, of_week - day * DAY_S
    raise _BadRowError("row without a time")


def _sigmas(
    values: dict[str, float], lat_deg: float, lon_deg: float
) -> tuple[tuple[float, float, float] | None, float]:
    """Return sigmas east, north, up and the covariance of east and north; RTKLIB writes covariances as signed roots."""
    if {"sde", "sdn", "sdu"} <= values.keys():
        sigma = usable_sigma(values["sde"], values["sdn"], values["sdu"])
        covariance = _squared(values.get("sdne", values.get("sden", 0.0)))
    elif {"sdx", "sdy", "sdz", "sdxy", "sdyz", "sdzx"} <= values.keys():
        roots = [values[name] for name in ("sdx", "sdy", "sdz", "sdxy", "sdyz", "sdzx")]
        if not all(abs(root) <= MAX_SIGMA_M for root in roots):
            return None, 0.0
        xx, yy, zz, xy, yz, zx = (_squared(root) for root in roots)
        enu_from_ecef = enu_axes((lat_deg, lon_deg, 0.0))
        turned = enu_from_ecef @ np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]) @ enu_from_ecef.T
        east, north, up = (math.sqrt(max(float(v), 0.0)) for v in np.diag(turned))
        sigma, covariance = usable_sigma(east, north, up), float(turned[0, 1])
    else:
        return None, 0.0
    if sigma is None or abs(covariance) > sigma[0] * sigma[1]:
        return sigma, 0.0
    return sigma, covariance


def _squared(root: float) -> float:
    """Return the square with the sign of its root."""
    return math.copysign(root * root, root)
