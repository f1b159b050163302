"""The tables of `groundstation onboard pose`: corners and runways in, poses out (docs/formats.md)."""

import csv
import io
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.files.csv_table import CsvTable
from groundstation.files.text_file import absence
from groundstation.files.toml_table import quoted, shown
from groundstation.files.whole_file import write_whole
from groundstation.onboard.pose.pose_solver import RunwayPose
from groundstation.onboard.pose.runway import Runway, runway_from_geodetic

POSE_COLUMNS = (
    "filename", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz", "range_m", "reprojection_px", "status",
)  # fmt: skip
_CORNER_COLUMNS = tuple(f"{axis}_{corner}" for corner in "ABCD" for axis in "xy")
# in radians a runway's coordinates are a fifty-seventh of its size apart
_NARROWEST_M = 2.0
_MOST_BYTES = 50_000_000
_MOST_NAMES = 12
_NAME = re.compile(r"^(?P<airport>[^_]+)_(?P<runway>[^_]+)_")
_NUMBER = re.compile(r"^(\d{1,2})")


class PoseError(InputError):
    """A table of corners or runways is not usable."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CornerRow:
    """One picture's corners: ``pixels`` (4, 2) in px, in any order; None where a cell is empty.

    ``where`` names the table and the line.
    """

    where: str
    filename: str
    airport: str
    runway: str
    pixels: FloatArray | None


def read_corners(path: Path) -> Iterator[CornerRow]:
    """Read the corners picture by picture; file names start with AIRPORT_RUNWAY_.

    Raises `InputError`, also for a table that has no picture.
    """
    table = CsvTable(path, ["filename", *_CORNER_COLUMNS])
    pictures = 0
    for row in table:
        pictures += 1
        name = row.text["filename"].strip()
        match = _NAME.match(name)
        if match is None:
            raise table.fault(row.line, got=f"filename = {name!r}", wanted="AIRPORT_RUNWAY_…, as in LFRS_03_35_10.jpeg")
        values = [table.optional_number(row, column) for column in _CORNER_COLUMNS]
        present = [value for value in values if value is not None]
        pixels = np.array(present).reshape(4, 2) if len(present) == len(values) else None
        if pixels is not None and np.all((pixels >= 0.0) & (pixels <= 1.0)):
            got = f"corners from {pixels.min():g} to {pixels.max():g}"
            raise table.fault(row.line, got=got, wanted="px, not shares of the picture")
        where = f"{path.name}: line {row.line}"
        yield CornerRow(where=where, filename=name, airport=match["airport"], runway=match["runway"], pixels=pixels)
    if not pictures:
        raise PoseError(str(path), got="no row below the header", wanted="one for each picture")


class Runways:
    """The runways of a JSON file: airport → runway → corners A to D with latitude, longitude and altitude."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._made: dict[tuple[str, str], Runway] = {}
        if not path.is_file():
            raise PoseError(str(path), got=absence(path), wanted="a JSON file of runways")
        try:
            if path.stat().st_size > _MOST_BYTES:
                raise PoseError(str(path), got="more than 50 MB", wanted="a table of runways")
            self._table = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise PoseError(str(path), got=os_words(error), wanted="a JSON file of runways") from error
        except json.JSONDecodeError as error:
            got = f"no JSON ({shown(error.msg)})"
            raise PoseError(f"{path}: line {error.lineno}", got=got, wanted="a JSON file of runways") from error
        except (ValueError, RecursionError) as error:
            raise PoseError(str(path), got="no JSON", wanted="a JSON file of runways") from error
        if not isinstance(self._table, dict):
            raise PoseError(str(path), got="no table", wanted="airport → runway → corners A, B, C, D")

    def find(self, airport: str, runway: str, asked: str = "") -> Runway:
        """Return one runway in its landing direction; raises `PoseError` where it is missing or not usable.

        ``asked`` is the place of its name for the message, such as a table and its line.
        """
        key = (airport, runway)
        if key not in self._made:
            self._made[key] = self._make(airport, runway, asked)
        return self._made[key]

    def _make(self, airport: str, runway: str, asked: str) -> Runway:
        where = f"{self._path.name}: {airport} {runway}"
        ends = self._table.get(airport)
        if not isinstance(ends, dict):
            raise PoseError(
                asked or str(self._path),
                got=f"airport {quoted(airport)}",
                wanted=f"one of {self._path.name}: {_some(self._table)}",
            )
        corners = ends.get(runway)
        if not isinstance(corners, dict):
            raise PoseError(
                asked or str(self._path),
                got=f"runway {quoted(runway)} of {airport}",
                wanted=f"one of {self._path.name}: {_some(ends)}",
            )
        places = np.array([_place(corners, name, where) for name in "ABCD"])
        first, second = places[:2], places[2:]
        # a runway is named after its landing heading in tens of degrees; C and D are near where the name gives none
        heading = _NUMBER.match(runway)
        if heading is not None and _along(first, second, 10.0 * float(heading[1])) > 0:
            made = runway_from_geodetic(first, second)
        else:
            made = runway_from_geodetic(second, first)
        _require_degrees(where, places, made)
        if not (made.length_m > 10.0 and made.width_m > 1.0):
            got = f"{made.length_m:.1f} m by {made.width_m:.1f} m"
            raise PoseError(where, got=got, wanted="a runway, A and B at one end, C and D at the other")
        return made


def _require_degrees(where: str, places: FloatArray, made: Runway) -> None:
    """Raise where coordinates (4, 3) are in radians: a runway that has a size only if they are."""
    small = np.all(np.abs(places[:, 0]) <= 0.5 * np.pi) and np.all(np.abs(places[:, 1]) <= np.pi)
    if small and made.width_m < _NARROWEST_M and np.degrees(made.width_m) > _NARROWEST_M:
        got = f"a runway of {made.length_m:.0f} m by {made.width_m:.2f} m at latitude {places[0, 0]:.4g}"
        raise PoseError(where, got=got, wanted="degrees; are these radians?")


def _some(table: Mapping[str, Any]) -> str:
    """Return the names in a table, the first of them where there are many."""
    names = ", ".join(list(table)[:_MOST_NAMES]) or "nothing"
    return shown(names, 200) + (f" and {len(table) - _MOST_NAMES} more" if len(table) > _MOST_NAMES else "")


def _place(corners: Mapping[str, Any], name: str, where: str) -> tuple[float, float, float]:
    """Return latitude, longitude, altitude of one corner."""
    try:
        at = corners[name]["coordinate"]
        place = tuple(float(at[key]) for key in ("latitude", "longitude", "altitude"))
    except (KeyError, TypeError, ValueError) as error:
        wanted = "coordinate with latitude, longitude, altitude"
        raise PoseError(f"{where}: corner {name}", got="none that can be read", wanted=wanted) from error
    lat, lon, height = place
    if not (abs(lat) <= 90.0 and abs(lon) <= 360.0 and abs(height) <= 1e4):
        raise PoseError(
            f"{where}: corner {name}", got=f"{lat}, {lon}, {height}", wanted="a place on Earth, in deg and m"
        )
    return lat, lon, height


def _along(start: FloatArray, end: FloatArray, heading_deg: float) -> float:
    """Return the component along a heading of the vector from one end to the other."""
    move = end.mean(axis=0) - start.mean(axis=0)
    east = move[1] * np.cos(np.radians(start[0, 0]))
    return float(move[0] * np.cos(np.radians(heading_deg)) + east * np.sin(np.radians(heading_deg)))


def write_poses(path: Path, rows: Iterator[tuple[str, RunwayPose | None, str]]) -> dict[str, int]:
    """Write (filename, pose, status) rows, empty cells for no pose; returns the count of each status.

    Nothing is written, and an older table stays, where one of the rows cannot be made.
    Raises `InputError` where the table, or its folder, cannot be written.
    """
    counts: dict[str, int] = {}
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(POSE_COLUMNS)
    for filename, pose, status in rows:
        out.writerow([filename, *_cells(pose), status])
        counts[status] = counts.get(status, 0) + 1
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text.getvalue())
    except OSError as error:
        raise PoseError(
            str(error.filename or path), got=os_words(error), wanted="--out with a file that can be written"
        ) from error
    return counts


def _cells(pose: RunwayPose | None) -> list[str]:
    if pose is None:
        return [""] * (len(POSE_COLUMNS) - 2)
    numbers = [f"{value:.4f}" for value in pose.position_m]
    numbers += [f"{value:.9f}" for value in pose.runway_from_camera_wxyz]
    return [*numbers, f"{pose.range_m:.4f}", f"{pose.reprojection_px:.4f}"]
