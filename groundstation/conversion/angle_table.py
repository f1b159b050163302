"""Conversion of a table of pan and tilt to ptu.csv, in the session's clock."""

import math
from dataclasses import dataclass
from pathlib import Path

from groundstation.conversion.import_clock import ImportClock
from groundstation.errors import InputError, SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.files.toml_table import quoted
from groundstation.rig.rig import Rig
from groundstation.session.logs.gps_time import TimeScale, civil_from_unix, gps_from_civil, gps_from_text
from groundstation.session.time_units import TIME_UNITS_S, spacing_hint

_TIMES = ("t_s", "utc", "unix_s")
_MAX_ROWS = 20_000_000
_MAX_DEG = 100_000.0
# of clocks that could be Unix time, in s: from 1980 to 2100
_FIRST_UNIX_S, _LAST_UNIX_S = 3.15e8, 4.1e9
# time zones are up to 14 h off UTC, some by quarters of an hour
_MOST_QUARTERS = 56


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleTable:
    """A table of angles as ``text`` of ptu.csv in the session's clock, with so many ``rows`` from first to last, s.

    ``closest_s`` is the time between the two rows that are nearest to each other; infinite where times state their
    unit, or there is one row.
    """

    name: str
    text: str
    rows: int
    first_s: float
    last_s: float
    closest_s: float

    def require_overlap(self, from_s: float, to_s: float) -> None:
        """Raise `InputError` unless some readings are of the time of the frames."""
        if self.first_s > to_s or self.last_s < from_s:
            unit = spacing_hint(self.closest_s)
            hint = f", {unit}" if unit else _zone_hint(self, from_s, to_s)
            got = f"angles from {self.first_s:.2f} to {self.last_s:.2f} s{hint}"
            raise InputError(self.name, got=got, wanted=f"some while the cameras ran, {from_s:.2f} to {to_s:.2f} s")


def read_angle_table(path: Path, rig: Rig, clock: ImportClock) -> AngleTable:
    """Read a table of angles; raises `SessionError` for one without a column or a row that is no reading."""
    turning = [s.name for s in rig.stations if not s.fixed]
    columns = [f"{name}_{axis}_deg" for name in turning for axis in ("pan", "tilt")]
    table = CsvTable(path, columns)
    kind = next((name for name in _TIMES if name in table.columns), None)
    if kind is None:
        got = ", ".join(table.columns[:6])
        raise SessionError(f"{path.name}: line 1", got=got, wanted="a column t_s, utc or unix_s")
    if kind != "t_s" and clock.epoch_gps_s is None:
        raise InputError(path.name, got="times in UTC", wanted="--epoch, or the videos' starts in UTC")
    lines = [",".join(["t_s", *columns])]
    first = before = None
    closest = math.inf
    for row in table:
        t = _time(table, row, kind, clock)
        table.check_later(row, kind, t, before)
        first = t if first is None else first
        if kind == "t_s" and before is not None:
            # the other kinds of times have a unit
            closest = min(closest, t - before)
        before = t
        cells = []
        for column in columns:
            value = table.optional_number(row, column)
            if value is not None and abs(value) > _MAX_DEG:
                raise table.fault(row.line, got=f"{column} = {value:g}", wanted="an angle in degrees")
            cells.append("" if value is None else row.text[column].strip())
        lines.append(",".join([f"{t:.6f}", *cells]))
        if len(lines) > _MAX_ROWS:
            raise table.fault(row.line, got="more rows", wanted=f"at most {_MAX_ROWS}")
    if first is None or before is None:
        raise InputError(path.name, got="no rows", wanted="readings while the cameras ran")
    return AngleTable(
        name=path.name,
        text="\n".join(lines) + "\n",
        rows=len(lines) - 1,
        first_s=first,
        last_s=before,
        closest_s=closest,
    )


def _zone_hint(table: AngleTable, from_s: float, to_s: float) -> str:
    """Return by how many hours a table's clock would be off if it were another time zone's; nothing if it is none's."""
    for quarters in sorted(range(-_MOST_QUARTERS, _MOST_QUARTERS + 1), key=abs):
        shift_s = 900.0 * quarters
        # half of the shorter of both is in the other
        overlap_s = min(table.last_s + shift_s, to_s) - max(table.first_s + shift_s, from_s)
        if quarters and overlap_s > 0.5 * min(table.last_s - table.first_s, to_s - from_s):
            return (
                f", which would fit {abs(quarters) / 4.0:g} h {'later' if quarters > 0 else 'earlier'}: a local time?"
            )
    return ""


def _time(table: CsvTable, row: Row, kind: str, clock: ImportClock) -> float:
    """Return a row's time in the session's clock."""
    if kind == "t_s":
        return table.number(row, kind) + clock.ptu_start_s
    epoch = clock.epoch_gps_s or 0.0
    if kind == "unix_s":
        _require_seconds(table, row, kind)
        return gps_from_civil(*civil_from_unix(table.number(row, kind)), TimeScale.UTC) - epoch
    gps_s = gps_from_text(row.text[kind])
    if gps_s is None:
        got = f"utc = {quoted(row.text[kind])}"
        raise table.fault(row.line, got=got, wanted="a time such as 2026-05-17T09:30:00.2Z")
    return gps_s - epoch


def _require_seconds(table: CsvTable, row: Row, column: str) -> None:
    """Raise `SessionError` for Unix time in another unit, which may be more than a number of a table can be."""
    try:
        value = float(row.text[column])
    except ValueError:
        return
    for unit, in_s in TIME_UNITS_S.items():
        if abs(value) > _LAST_UNIX_S and _FIRST_UNIX_S < value * in_s < _LAST_UNIX_S:
            got = f"{column} = {quoted(row.text[column].strip())}, which would be a time of our days in {unit}"
            raise table.fault(row.line, got=got, wanted="seconds since 1970")
