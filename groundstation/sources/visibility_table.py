"""How well each frame of a rendered session shows the aircraft: visibility.csv, one row for each frame and station.

The renderer writes it before any detector runs, so that which frames count is not decided by what finds them.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from groundstation.errors import SessionError
from groundstation.files.csv_table import CsvTable
from groundstation.files.output_names import below
from groundstation.session import Session

FILE_NAME = "visibility.csv"
COLUMNS = ("index", "station", "width_px", "in_view", "unhidden", "snr")


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameVisibility:
    """True visibility of the aircraft in one frame.

    Attributes
    ----------
    width_px : width of the whole silhouette's bounding box, including its part outside the picture.
    in_view : share of the silhouette inside the picture, 0 to 1.
    unhidden : share of the silhouette inside the picture that no nearer object hides, 0 to 1.
    snr : matched-filter signal-to-noise ratio of the visible part: root of the sum over its pixels of
        (change of the grey level by the aircraft / noise)².
    """

    width_px: float
    in_view: float
    unhidden: float
    snr: float

    @property
    def share_seen(self) -> float:
        """Share of the whole silhouette that is inside the picture and not hidden."""
        return self.in_view * self.unhidden


def write_visibility(folder: Path, rows: Iterable[tuple[int, str, FrameVisibility]]) -> None:
    """Write visibility.csv from rows of (frame index, station, visibility)."""
    with below(folder, FILE_NAME).open("w", encoding="utf-8") as file:
        file.write(",".join(COLUMNS) + "\n")
        for index, station, seen in rows:
            file.write(f"{index},{station},{seen.width_px:.2f},{seen.in_view:.4f},{seen.unhidden:.4f},{seen.snr:.2f}\n")


def read_visibility(session: Session) -> Mapping[tuple[str, int], FrameVisibility] | None:
    """Return visibility by station and frame index; None where the session has no such table.

    Raises `SessionError` where the table is damaged.
    """
    path = session.folder / FILE_NAME
    if not path.is_file():
        return None
    table = CsvTable(path, COLUMNS)
    found: dict[tuple[str, int], FrameVisibility] = {}
    for row in table:
        station, index = row.text["station"].strip(), table.number(row, "index")
        if station not in session.rig.names:
            raise table.fault(row.line, got=f"station {station!r}", wanted=f"one of {', '.join(session.rig.names)}")
        values = {name: table.number(row, name) for name in COLUMNS[2:]}
        for name in ("in_view", "unhidden"):
            if not 0.0 <= values[name] <= 1.0:
                raise table.fault(row.line, got=f"{name} = {values[name]:g}", wanted="a share from 0 to 1")
        if index != int(index) or index < 0 or min(values.values()) < 0.0:
            raise table.fault(row.line, got="a negative number or a broken index", wanted="numbers ≥ 0")
        found[station, int(index)] = FrameVisibility(**values)
    if not found:
        raise SessionError(str(path), got="no rows", wanted="one for each frame and station")
    return found
