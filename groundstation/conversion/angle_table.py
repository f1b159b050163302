"""Conversion of a table of pan and tilt to ptu.csv, in the session's clock."""

from pathlib import Path

from groundstation.conversion.import_clock import ImportClock
from groundstation.errors import InputError, SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.files.toml_table import quoted
from groundstation.rig.rig import Rig
from groundstation.session.logs.gps_time import TimeScale, civil_from_unix, gps_from_civil, gps_from_text

_TIMES = ("t_s", "utc", "unix_s")
_MAX_ROWS = 20_000_000
_MAX_DEG = 100_000.0


def ptu_csv(path: Path, rig: Rig, clock: ImportClock, from_s: float, to_s: float) -> tuple[str, int]:
    """Return ptu.csv's text and how many rows it has.

    ``from_s`` and ``to_s`` are first and last frame. Raises `SessionError` for a row that is no reading, and
    `InputError` for a table that has no time in common with the frames.
    """
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
    for row in table:
        t = _time(table, row, kind, clock)
        table.check_later(row, kind, t, before)
        first = t if first is None else first
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
    if first is None or before is None or first > to_s or before < from_s:
        got = "no rows" if first is None else f"angles from {first:.2f} to {before:.2f} s"
        raise InputError(path.name, got=got, wanted=f"some while the cameras ran, {from_s:.2f} to {to_s:.2f} s")
    return "\n".join(lines) + "\n", len(lines) - 1


def _time(table: CsvTable, row: Row, kind: str, clock: ImportClock) -> float:
    """Return a row's time in the session's clock."""
    if kind == "t_s":
        return table.number(row, kind) + clock.ptu_start_s
    epoch = clock.epoch_gps_s or 0.0
    if kind == "unix_s":
        return gps_from_civil(*civil_from_unix(table.number(row, kind)), TimeScale.UTC) - epoch
    gps_s = gps_from_text(row.text[kind])
    if gps_s is None:
        got = f"utc = {quoted(row.text[kind])}"
        raise table.fault(row.line, got=got, wanted="a time such as 2026-05-17T09:30:00.2Z")
    return gps_s - epoch
