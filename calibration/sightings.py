"""Landmarks seen through a station: the tables that `calibrate mount`, `survey` and `check` read (docs/formats.md)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.files.toml_table import quoted

SIGHTING_COLUMNS = ("station", "landmark", "pan_deg", "tilt_deg", "u_px", "v_px")
LANDMARK_COLUMNS = ("landmark", "x_m", "y_m", "z_m")
DEFAULT_SIGMA_PX = 0.3
DEFAULT_SIGMA_M = 0.02
MAX_SIGHTINGS = 100_000
MAX_LANDMARKS = 10_000
MAX_NAME_CHARACTERS = 64
# an axis turns further than once at most by its cable; a tilt never does
MAX_PAN_DEG = 720.0
MAX_TILT_DEG = 180.0
MAX_SIGMA_PX = 1000.0
MAX_SIGMA_M = 1000.0
# readings this close are one place read twice: noise gives no sense of motion
STANDING_DEG = 0.1
Kind = Literal["point", "direction"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LandmarkSighting:
    """One landmark in one picture, with the angles read while the PTU was at rest.

    Attributes
    ----------
    pan_rad, tilt_rad : the encoder's readings.
    pixel_px : (2,) u, v; ``sigma_px`` one sigma of each.
    t_s : time in the file's own clock, or None.
    pan_from, tilt_from : +1 or -1, the last direction of motion of the axis; 0 if unknown.
    line : line number in the file.
    """

    station: str
    landmark: str
    pan_rad: float
    tilt_rad: float
    pixel_px: FloatArray
    sigma_px: float
    t_s: float | None
    pan_from: int
    tilt_from: int
    line: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Landmark:
    """A mark that does not move.

    ``place`` (3,) is a point in m, runway frame; of kind ``direction`` a unit vector, runway frame; None where it
    is unknown. ``sigma`` (3,) is one sigma of each component, m, or rad of a direction.
    """

    name: str
    kind: Kind
    place: FloatArray | None
    sigma: FloatArray


def read_sightings(path: Path) -> tuple[LandmarkSighting, ...]:
    """Read sightings.csv, in the file's order; raises `SessionError` with file, line, got and wanted."""
    table = CsvTable(path, SIGHTING_COLUMNS)
    found: list[LandmarkSighting] = []
    last: dict[str, LandmarkSighting] = {}
    for row in table:
        if len(found) == MAX_SIGHTINGS:
            raise table.fault(row.line, got="one more row", wanted=f"at most {MAX_SIGHTINGS} sightings")
        sighting = _sighting(table, row, last.get(row.text["station"].strip()))
        last[sighting.station] = sighting
        found.append(sighting)
    if not found:
        raise SessionError(str(path), got="no row", wanted="at least one sighting of a landmark")
    return tuple(found)


def read_landmarks(path: Path) -> dict[str, Landmark]:
    """Read landmarks.csv: name to landmark, in the file's order; raises `SessionError` for a fault."""
    table = CsvTable(path, LANDMARK_COLUMNS)
    found: dict[str, Landmark] = {}
    for row in table:
        if len(found) == MAX_LANDMARKS:
            raise table.fault(row.line, got="one more row", wanted=f"at most {MAX_LANDMARKS} landmarks")
        landmark = _landmark(table, row)
        if landmark.name in found:
            raise table.fault(row.line, got=f"{quoted(landmark.name)} a second time", wanted="each landmark once")
        found[landmark.name] = landmark
    if not found:
        raise SessionError(str(path), got="no row", wanted="at least one landmark")
    return found


def require_consistent(
    sightings: Sequence[LandmarkSighting], landmarks: Mapping[str, Landmark], stations: Sequence[str], path: Path
) -> None:
    """Raise `InputError` for the first sighting whose landmark or station is unknown."""
    for sighting in sightings:
        where = f"{path.name}: line {sighting.line}"
        if sighting.station not in stations:
            wanted = "a station of the rig: " + ", ".join(stations)
            raise InputError(where, got=f"station {quoted(sighting.station)}", wanted=wanted)
        if sighting.landmark not in landmarks:
            known = ", ".join(list(landmarks)[:12]) + (", …" if len(landmarks) > 12 else "")
            got = f"landmark {quoted(sighting.landmark)}"
            raise InputError(where, got=got, wanted=f"one of the table of landmarks: {known}")


def _sighting(table: CsvTable, row: Row, before: LandmarkSighting | None) -> LandmarkSighting:
    pan = _within(table, row, "pan_deg", -MAX_PAN_DEG, MAX_PAN_DEG)
    tilt = _within(table, row, "tilt_deg", -MAX_TILT_DEG, MAX_TILT_DEG)
    pan_before = None if before is None else float(np.degrees(before.pan_rad))
    tilt_before = None if before is None else float(np.degrees(before.tilt_rad))
    return LandmarkSighting(
        station=_name(table, row, "station"),
        landmark=_name(table, row, "landmark"),
        pan_rad=float(np.radians(pan)),
        tilt_rad=float(np.radians(tilt)),
        pixel_px=np.array([table.number(row, "u_px"), table.number(row, "v_px")]),
        sigma_px=_optional(table, row, "sigma_px", DEFAULT_SIGMA_PX, MAX_SIGMA_PX, above_zero=True),
        t_s=table.optional_number(row, "t_s") if "t_s" in table.columns else None,
        pan_from=_sense(table, row, "pan_from", pan, pan_before, 0 if before is None else before.pan_from),
        tilt_from=_sense(table, row, "tilt_from", tilt, tilt_before, 0 if before is None else before.tilt_from),
        line=row.line,
    )


def _landmark(table: CsvTable, row: Row) -> Landmark:
    name = _name(table, row, "landmark")
    word = row.text["kind"].strip() if "kind" in table.columns else ""
    if word not in ("", "point", "direction"):
        raise table.fault(row.line, got=f"kind = {quoted(word)}", wanted="point or direction")
    kind: Kind = "direction" if word == "direction" else "point"
    cells = [table.optional_number(row, column) for column in ("x_m", "y_m", "z_m")]
    usual = DEFAULT_SIGMA_M if kind == "point" else 0.0
    sigma = np.array([_optional(table, row, f"sigma_{axis}_m", usual, MAX_SIGMA_M) for axis in "xyz"])
    numbers = [cell for cell in cells if cell is not None]
    if not numbers:
        return Landmark(name=name, kind=kind, place=None, sigma=sigma)
    if len(numbers) < 3:
        raise table.fault(row.line, got=f"{len(numbers)} of x_m, y_m, z_m", wanted="all three, or three empty cells")
    place = np.array(numbers)
    if kind == "direction":
        length = float(np.linalg.norm(place))
        if length < 1e-9:
            raise table.fault(row.line, got="a direction of length 0", wanted="x, y, z that point somewhere")
        place, sigma = place / length, sigma / length
    return Landmark(name=name, kind=kind, place=place, sigma=sigma)


def _name(table: CsvTable, row: Row, column: str) -> str:
    name = row.text[column].strip()
    if not name:
        raise table.fault(row.line, got=f"an empty {column}", wanted="a name")
    if len(name) > MAX_NAME_CHARACTERS or not name.isprintable():
        wanted = f"at most {MAX_NAME_CHARACTERS} printable characters"
        raise table.fault(row.line, got=f"{column} = {quoted(name)}", wanted=wanted)
    return name


def _within(table: CsvTable, row: Row, column: str, least: float, most: float) -> float:
    value = table.number(row, column)
    if not least <= value <= most:
        raise table.fault(row.line, got=f"{column} = {value:g}", wanted=f"a number from {least:g} to {most:g}")
    return value


def _optional(
    table: CsvTable, row: Row, column: str, otherwise: float, most: float, *, above_zero: bool = False
) -> float:
    """Return a sigma; ``otherwise`` where there is no column or an empty cell."""
    value = table.optional_number(row, column) if column in table.columns else None
    if value is None:
        return otherwise
    if not 0.0 <= value <= most or (above_zero and value == 0.0):
        least = "above 0" if above_zero else "from 0"
        raise table.fault(row.line, got=f"{column} = {value:g}", wanted=f"a number {least} to {most:g}")
    return value


def _sense(
    table: CsvTable, row: Row, column: str, angle_deg: float, before_deg: float | None, before_sense: int
) -> int:
    """Return the last direction of motion of an axis: from the cell, otherwise from the station's row before."""
    value = table.optional_number(row, column) if column in table.columns else None
    if value is not None:
        if value not in (1.0, -1.0):
            raise table.fault(row.line, got=f"{column} = {value:g}", wanted="1 or -1, or an empty cell")
        return int(value)
    if before_deg is None or abs(angle_deg - before_deg) < STANDING_DEG:
        return before_sense
    return 1 if angle_deg > before_deg else -1
