"""An autopilot's position log, as a table of latitude, longitude and altitude, in a local east-north-up frame."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.files.csv_table import CsvTable, Row
from groundstation.geometry.geodesy import enu_from_geodetic

LOG_COLUMNS = ("timestamp", "Lat", "Lng", "Alt")
MAX_LOG_ROWS = 1_000_000
# one flight field; a row far from the first is no position, as 0, 0 of a receiver without a fix
MAX_EXTENT_M = 50_000.0
_MAX_ALTITUDE_M = 20_000.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightLog:
    """A flown track: ``t_s`` (n,) rising, s since the first row; ``position_enu_m`` (n, 3) from the first row on.

    ``origin_deg_m`` is the first row's latitude, longitude and altitude.
    """

    t_s: FloatArray
    position_enu_m: FloatArray
    origin_deg_m: tuple[float, float, float]


def load_flight_log(path: Path) -> FlightLog:
    """Read a CSV table with the columns timestamp (s), Lat, Lng (degrees) and Alt (m), others left alone.

    Raises `SessionError` with file and line of the first fault: a missing column, a value out of its range, a time
    that does not rise, a place too far from the first.
    """
    table = CsvTable(path, LOG_COLUMNS)
    rows: list[tuple[float, float, float, float]] = []
    lines: list[int] = []
    before: float | None = None
    for row in table:
        before = table.advance(row, "timestamp", before)
        lat = _within(table, row, "Lat", 90.0)
        lon = _within(table, row, "Lng", 180.0)
        rows.append((before, lat, lon, _within(table, row, "Alt", _MAX_ALTITUDE_M)))
        lines.append(row.line)
        if len(rows) > MAX_LOG_ROWS:
            raise table.fault(row.line, got="more rows", wanted=f"at most {MAX_LOG_ROWS}")
    if len(rows) < 2:
        raise table.fault(1, got=f"{len(rows)} rows below it", wanted="two or more")
    t, lat, lon, height = np.array(rows).T
    origin = (float(lat[0]), float(lon[0]), float(height[0]))
    position = enu_from_geodetic(lat, lon, height, origin)
    distance = np.linalg.norm(position, axis=1)
    if distance.max() > MAX_EXTENT_M:
        k = int(np.argmax(distance > MAX_EXTENT_M))
        got = f"a place {distance[k] / 1e3:.0f} km from the first row's"
        raise table.fault(lines[k], got=got, wanted=f"at most {MAX_EXTENT_M / 1e3:.0f} km")
    return FlightLog(t_s=t - t[0], position_enu_m=position, origin_deg_m=origin)


def _within(table: CsvTable, row: Row, column: str, limit: float) -> float:
    """Return a number of at most ``limit`` in size."""
    value = table.number(row, column)
    if abs(value) > limit:
        raise table.fault(row.line, got=f"{column} = {value:g}", wanted=f"at most {limit:g} in size")
    return value
