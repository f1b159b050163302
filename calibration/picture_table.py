"""The table of a calibration's pictures, pictures.csv: file, station, angles as read, and when it was taken."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.sightings import MAX_PAN_DEG, MAX_TILT_DEG, STANDING_DEG
from groundstation.errors import InputError, SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.files.toml_table import quoted
from groundstation.rig.rig import Rig

PICTURE_COLUMNS = ("file", "station", "pan_deg", "tilt_deg")
TIME_COLUMN, READINGS_COLUMN = "t_utc_s", "readings"
MAX_PICTURES = 10_000
MAX_READINGS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class ListedPicture:
    """One row of pictures.csv.

    Attributes
    ----------
    file : below the table's folder. station : a name of the rig.
    reading_deg : pan and tilt as read; ``sense`` the last direction of motion of each, +1, −1 or 0.
    utc_s : Unix time of the mid-exposure; NaN where the table has no times.
    readings : how many readings the angles are the mean of.
    line : of the table.
    """

    file: str
    station: str
    reading_deg: tuple[float, float]
    sense: tuple[int, int]
    utc_s: float
    readings: int
    line: int


def read_picture_table(folder: Path, rig: Rig, *, timed: bool = False) -> list[ListedPicture]:
    """Return the rows of ``folder``/pictures.csv; with times where ``timed``; raises `InputError`."""
    if not folder.is_dir():
        raise InputError(str(folder), got="no such folder", wanted="a folder of pictures with pictures.csv")
    table = CsvTable(folder / "pictures.csv", (*PICTURE_COLUMNS, *((TIME_COLUMN,) if timed else ())))
    listed: list[ListedPicture] = []
    last: dict[str, ListedPicture] = {}
    for row in table:
        if len(listed) == MAX_PICTURES:
            raise table.fault(row.line, got="one more row", wanted=f"at most {MAX_PICTURES} pictures")
        item = _item(table, row, rig, last, timed)
        last[item.station] = item
        listed.append(item)
    if not listed:
        raise SessionError("pictures.csv", got="no row", wanted="a row for each picture")
    return listed


def _item(table: CsvTable, row: Row, rig: Rig, last: dict[str, ListedPicture], timed: bool) -> ListedPicture:
    file, station = row.text["file"].strip(), row.text["station"].strip()
    if not file or Path(file).is_absolute() or ".." in Path(file).parts:
        raise table.fault(row.line, got=f"file = {quoted(file)}", wanted="a picture inside the folder")
    if station not in rig.names:
        raise table.fault(row.line, got=f"station {quoted(station)}", wanted="one of " + ", ".join(rig.names))
    reading = (table.number(row, "pan_deg"), table.number(row, "tilt_deg"))
    for value, name, most in zip(reading, ("pan_deg", "tilt_deg"), (MAX_PAN_DEG, MAX_TILT_DEG), strict=True):
        if abs(value) > most:
            raise table.fault(row.line, got=f"{name} = {value:g}", wanted=f"a number from {-most:g} to {most:g}")
    before = last.get(station)
    senses = []
    for axis, column in enumerate(("pan_from", "tilt_from")):
        reported = table.optional_number(row, column) if column in table.columns else None
        if reported is not None and reported not in (1.0, -1.0):
            raise table.fault(row.line, got=f"{column} = {reported:g}", wanted="1 or -1, or an empty cell")
        step = 0.0 if before is None else reading[axis] - before.reading_deg[axis]
        moved = int(np.sign(step)) if abs(step) >= STANDING_DEG else (0 if before is None else before.sense[axis])
        senses.append(int(reported) if reported is not None else moved)
    return ListedPicture(
        file=file,
        station=station,
        reading_deg=reading,
        sense=(senses[0], senses[1]),
        utc_s=table.number(row, TIME_COLUMN) if timed else float("nan"),
        readings=_readings(table, row),
        line=row.line,
    )


def _readings(table: CsvTable, row: Row) -> int:
    """Return the number of readings that a row's angles are the mean of, 1 unless stated."""
    count = table.optional_number(row, READINGS_COLUMN) if READINGS_COLUMN in table.columns else None
    if count is None:
        return 1
    if not 1.0 <= count <= MAX_READINGS or count != int(count):
        raise table.fault(row.line, got=f"readings = {count:g}", wanted=f"a whole number from 1 to {MAX_READINGS}")
    return int(count)
