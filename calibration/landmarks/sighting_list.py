"""The list that `groundstation calibrate sightings --from` reads: where to turn to, and the mark's pixel there."""

from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.sightings import MAX_PAN_DEG, MAX_TILT_DEG
from groundstation.arrays import FloatArray
from groundstation.errors import SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.files.toml_table import quoted

_COLUMNS = ("landmark", "pan_deg", "tilt_deg")
_MAX_ROWS = 10_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ListedSighting:
    """One row: readings of pan and tilt to turn to, rad, and the mark's pixel (2,) there, None to find it."""

    landmark: str
    pan_rad: float
    tilt_rad: float
    pixel_px: FloatArray | None


def read_sighting_list(path: Path, landmarks: Container[str]) -> tuple[ListedSighting, ...]:
    """Read the list; raises `SessionError` with file, line, got and wanted."""
    table = CsvTable(path, _COLUMNS)
    found: list[ListedSighting] = []
    for row in table:
        if len(found) == _MAX_ROWS:
            raise table.fault(row.line, got="one more row", wanted=f"at most {_MAX_ROWS} rows")
        name = row.text["landmark"].strip()
        if name not in landmarks:
            raise table.fault(row.line, got=f"landmark {quoted(name)}", wanted="one of the table of landmarks")
        pan, tilt = _angle(table, row, "pan_deg", MAX_PAN_DEG), _angle(table, row, "tilt_deg", MAX_TILT_DEG)
        found.append(ListedSighting(landmark=name, pan_rad=pan, tilt_rad=tilt, pixel_px=_pixel(table, row)))
    if not found:
        raise SessionError(str(path), got="no row", wanted="at least one landmark to turn to")
    return tuple(found)


def _angle(table: CsvTable, row: Row, column: str, most_deg: float) -> float:
    value = table.number(row, column)
    if abs(value) > most_deg:
        raise table.fault(row.line, got=f"{column} = {value:g}", wanted=f"a number from {-most_deg:g} to {most_deg:g}")
    return float(np.radians(value))


def _pixel(table: CsvTable, row: Row) -> FloatArray | None:
    cells = [table.optional_number(row, name) if name in table.columns else None for name in ("u_px", "v_px")]
    numbers = [cell for cell in cells if cell is not None]
    if len(numbers) == 1:
        raise table.fault(row.line, got="one of u_px, v_px", wanted="both, or two empty cells")
    return np.array(numbers) if numbers else None
