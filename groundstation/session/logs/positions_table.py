"""A CSV table of positions: columns by name, with the unit in the name or in brackets behind it."""

import math
import re
from pathlib import Path

from groundstation.errors import LogError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.files.toml_table import quoted
from groundstation.session.logs.fixes import (
    FixQuality,
    Heights,
    LogFix,
    LogOptions,
    ReadingNotes,
    check_count,
    usable_sigma,
)
from groundstation.session.logs.gps_time import (
    DAY_S,
    WEEK_S,
    TimeScale,
    civil_from_unix,
    gps_from_text,
    leap_seconds,
    utc_day,
)

_DEGREES = {"deg": 1.0, "e7": 1e-7, "rad": 180.0 / math.pi}
_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048}
_SECONDS = {"s": 1.0, "ms": 1e-3}
_NAMES = {
    "lat": ("lat", "latitude"),
    "lon": ("lon", "lng", "long", "longitude"),
    "ellipsoid": ("height", "ellipsoid_height", "height_ellipsoid", "alt_ellipsoid", "altitude_ellipsoid"),
    "sea": ("alt_msl", "altitude_msl", "height_msl", "alt_amsl", "altitude_amsl", "elevation", "orthometric_height"),
    "either": ("alt", "altitude"),
    "separation": ("geoid_separation", "undulation"),
    "sigma_e": ("sigma_e", "sigma_east", "sde"),
    "sigma_n": ("sigma_n", "sigma_north", "sdn"),
    "sigma_u": ("sigma_u", "sigma_up", "sdu"),
    "unix": ("unix", "unix_time"),
    "tow": ("gps_tow", "tow"),
}
_UNITS = {"lat": _DEGREES, "lon": _DEGREES, "unix": {"s": 1.0}, "tow": _SECONDS}
_UTC_NAMES = ("utc", "time_utc", "utc_time", "datetime_utc")
_STATUS_NAMES = ("status", "quality", "fix")
_WEEK_NAMES = ("gps_week", "week")


class _Column:
    """A column of the file and what its cells are multiplied with."""

    def __init__(self, table: CsvTable, name: str, scale: float) -> None:
        self._table = table
        self._name = name
        self._scale = scale

    def value(self, row: Row) -> float:
        """Return a cell in m, degrees or s."""
        return self._scale * self._table.number(row, self._name)

    def optional(self, row: Row) -> float | None:
        """Return a cell, None where it is empty."""
        value = self._table.optional_number(row, self._name)
        return None if value is None else self._scale * value


def has_positions(columns: tuple[str, ...]) -> bool:
    """Return whether a table's header has latitudes."""
    return any(_plain(name).rpartition("_")[0] in _NAMES["lat"] or _plain(name) in _NAMES["lat"] for name in columns)


def read_positions(path: Path, options: LogOptions, remarks: ReadingNotes) -> list[LogFix]:
    """Read a table. Raises `LogError` where a column or its unit is missing, `SessionError` at the first faulty row."""
    return _PositionsTable(path, options, remarks).fixes()


class _PositionsTable:
    """One table, its columns found."""

    def __init__(self, path: Path, options: LogOptions, remarks: ReadingNotes) -> None:
        self._table = CsvTable(path, [])
        self._remarks = remarks
        self._path = path
        self._heights = Heights(path, options)
        self._plain = {_plain(name): name for name in self._table.columns}
        self._columns = {kind: self._find(kind) for kind in _NAMES}
        self._utc, self._week, self._status = (
            next((self._plain[n] for n in names if n in self._plain), None)
            for names in (_UTC_NAMES, _WEEK_NAMES, _STATUS_NAMES)
        )
        for kind in ("lat", "lon"):
            if self._columns[kind] is None:
                raise self._fault(f"no column of {kind}", f"{kind}_deg")
        if self._utc is None and self._columns["unix"] is None and (self._week is None or self._columns["tow"] is None):
            raise self._fault("no column of time", "utc (2026-05-17T09:30:00.2Z), unix_s, or gps_week and gps_tow_s")
        if self._columns["either"] is not None and self._columns["ellipsoid"] is None and self._columns["sea"] is None:
            if options.height is None:
                wanted = (
                    "height_m (above the ellipsoid), alt_msl_m, or a word which it is: height in [dgps], or --height"
                )
                raise self._fault("an altitude without a reference surface", wanted)
            remarks.used.add("height")
            self._columns["ellipsoid" if options.height == "ellipsoid" else "sea"] = self._columns["either"]
        if self._columns["ellipsoid"] is None and self._columns["sea"] is None:
            raise self._fault("no column of height", "height_m (above the ellipsoid) or alt_msl_m")

    def fixes(self) -> list[LogFix]:
        """Return all rows."""
        fixes = []
        for row in self._table:
            fixes.append(self._fix(row))
            if len(fixes) % 10_000 == 0:
                check_count(self._path, fixes)
        return fixes

    def _fault(self, got: str, wanted: str) -> LogError:
        return LogError(f"{self._path.name}: line 1", got=got, wanted=wanted)

    def _find(self, kind: str) -> _Column | None:
        """Return the column of a kind; raises `LogError` where its header has no unit, or one that is not known."""
        units = _UNITS.get(kind, _METRES)
        for name in _NAMES[kind]:
            for unit, scale in units.items():
                if f"{name}_{unit}" in self._plain:
                    return _Column(self._table, self._plain[f"{name}_{unit}"], scale)
            if name in self._plain:
                wanted = " or ".join(f"{name}_{unit}" for unit in units)
                raise self._fault(f"{quoted(self._plain[name])}, without a unit", wanted)
        return None

    def _fix(self, row: Row) -> LogFix:
        day, second, scale = self._time(row)
        lat, lon = self._columns["lat"], self._columns["lon"]
        sigmas = [c.optional(row) for k in ("sigma_e", "sigma_n", "sigma_u") if (c := self._columns[k]) is not None]
        known = [s for s in sigmas if s is not None]
        word = row.text[self._status].strip().lower() if self._status else ""
        values = (
            0.0 if lat is None else self._within(row, lat.value(row), 90.0, "latitude"),
            0.0 if lon is None else self._within(row, lon.value(row), 360.0, "longitude"),
            self._within(row, self._height(row), 1e5, "height"),
        )
        return LogFix(
            day=day,
            second=second,
            scale=scale,
            lat_deg=values[0],
            lon_deg=values[1],
            height_m=values[2],
            quality=FixQuality(word) if word in tuple(FixQuality) else FixQuality.UNKNOWN,
            sigma_enu_m=usable_sigma(*known) if len(known) == 3 else None,
        )

    def _within(self, row: Row, value: float, limit: float, what: str) -> float:
        if abs(value) > limit:
            raise self._table.fault(row.line, got=f"a {what} of {value:g}", wanted=f"at most {limit:g} in size")
        return value

    def _height(self, row: Row) -> float:
        ellipsoid, sea, separation = (self._columns[k] for k in ("ellipsoid", "sea", "separation"))
        if ellipsoid is not None:
            return ellipsoid.value(row)
        given = separation.optional(row) if separation is not None else None
        return self._heights.ellipsoid(0.0 if sea is None else sea.value(row), given)

    def _time(self, row: Row) -> tuple[int, float, TimeScale]:
        """Return day, second and scale of a row's time."""
        unix, tow = self._columns["unix"], self._columns["tow"]
        if self._utc is not None:
            gps_s = gps_from_text(row.text[self._utc])
            if gps_s is None:
                got = f"{self._utc} = {quoted(row.text[self._utc])}"
                raise self._table.fault(row.line, got=got, wanted="a time such as 2026-05-17T09:30:00.2Z")
            day = utc_day(gps_s)
            return day, gps_s - leap_seconds(day) - day * DAY_S, TimeScale.UTC
        if unix is not None:
            return *civil_from_unix(self._within(row, unix.value(row), 1e10, "Unix time")), TimeScale.UTC
        week = self._table.number(row, str(self._week))
        of_week = 0.0 if tow is None else tow.value(row)
        if not (0 <= of_week < WEEK_S and 0 <= week < 10_000 and week.is_integer()):
            got = f"week {week:g}, second {of_week:g}"
            raise self._table.fault(row.line, got=got, wanted=f"a whole GPS week and 0 to {WEEK_S:g} s of it")
        whole = int(of_week // DAY_S)
        return 7 * int(week) + whole, of_week - whole * DAY_S, TimeScale.GPS


def _plain(name: str) -> str:
    """Return a column's name in small letters, with a unit in brackets as its ending."""
    return re.sub(r"[\s_]*[\[(]\s*([^\])]*?)\s*[\])]\s*$", r"_\1", name.strip()).lower().replace(" ", "_")
