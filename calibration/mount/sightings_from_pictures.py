"""Sightings out of pictures: the corners of a board, or the one lamp, at angles that pictures.csv gives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration.lens.boards import CalibrationBoard
from calibration.lens.corners import CornerFinder
from calibration.mount.parameters import UNKNOWN_DISTANCE_M
from calibration.mount.problem import Mark, MarkKind, MountSightings
from calibration.sightings import MAX_PAN_DEG, MAX_TILT_DEG, STANDING_DEG
from groundstation.arrays import FloatArray, ImageArray
from groundstation.errors import InputError, SessionError
from groundstation.files.csv_table import CsvTable, Row
from groundstation.files.toml_table import quoted
from groundstation.rig.rig import Rig
from groundstation.session.media import read_image

PICTURE_COLUMNS = ("file", "station", "pan_deg", "tilt_deg")
MAX_PICTURES = 10_000
# corners of a sharp board, and a lamp's centroid, per axis
CORNER_SIGMA_PX = 0.1
LAMP_SIGMA_PX = 0.15
_LEAST_CORNERS = 6
# a lamp stands out of the picture by so many times the scatter of what surrounds it, and is small and compact
_LAMP_SIGMAS = 8.0
_LEAST_GREY = 20.0
_LAMP_SHARE_OF_PEAK = 0.3
_LARGEST_LAMP = 0.04
_LEAST_FILL = 0.4
_RIVAL = 0.7


@dataclass(frozen=True, slots=True, kw_only=True)
class _ListedPicture:
    file: str
    station: str
    reading_deg: tuple[float, float]
    sense: tuple[int, int]
    line: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PictureSightings:
    """Sightings by station, the marks, and the pictures that gave none, each with the reason."""

    seen: dict[str, MountSightings]
    marks: tuple[Mark, ...]
    without: tuple[str, ...]


def sightings_of_pictures(
    folder: Path, rig: Rig, board: CalibrationBoard | None, progress: Callable[[int], None] = lambda _: None
) -> PictureSightings:
    """Find the board, or without one the lamp, in every picture of ``folder``/pictures.csv.

    Raises `InputError` for a faulty table or picture, or if nothing is found.
    """
    listed = _read_table(folder, rig)
    finder = CornerFinder(board) if board is not None else None
    rows: dict[str, list[tuple[_ListedPicture, FloatArray, FloatArray]]] = {}
    without = []
    for number, item in enumerate(listed):
        progress(number + 1)
        grey = _grey(folder, item, rig)
        if finder is None:
            lamp = find_lamp(grey)
            found = (np.zeros((1, 3)), lamp.reshape(1, 2)) if isinstance(lamp, np.ndarray) else lamp
        else:
            view = finder.find(item.file, grey)
            enough = view is not None and len(view.ids) >= _LEAST_CORNERS
            found = (view.board_m, view.pixel) if view is not None and enough else "no board, or too little of it"
        if isinstance(found, str):
            without.append(f"{item.file}: {found}")
        else:
            rows.setdefault(item.station, []).append((item, *found))
    if not rows:
        what = "lamp" if board is None else "board"
        raise InputError(
            str(folder), got=f"no {what} in any of {len(listed)} pictures", wanted=f"pictures of one {what}"
        )
    kind = MarkKind.UNKNOWN_POINT if board is None else MarkKind.BOARD
    mark = Mark(
        name="lamp" if board is None else "board",
        kind=kind,
        place_m=np.array([0.0, UNKNOWN_DISTANCE_M, 0.0]),
        sigma=np.zeros(3),
        runway_from_board=np.eye(3),
    )
    sigma = LAMP_SIGMA_PX if board is None else CORNER_SIGMA_PX
    return PictureSightings(
        seen={name: _sightings(own, sigma) for name, own in rows.items()}, marks=(mark,), without=tuple(without)
    )


def _sightings(rows: Sequence[tuple[_ListedPicture, FloatArray, FloatArray]], sigma_px: float) -> MountSightings:
    counts = [len(pixel) for _, _, pixel in rows]
    total = sum(counts)
    return MountSightings(
        reading_rad=np.repeat(np.radians([item.reading_deg for item, _, _ in rows]), counts, axis=0),
        sense=np.repeat(np.array([item.sense for item, _, _ in rows], dtype=np.float64), counts, axis=0),
        pixel_px=np.concatenate([pixel for _, _, pixel in rows]),
        sigma_px=np.full(total, sigma_px),
        pointing=np.repeat(np.arange(len(rows)), counts),
        mark=np.zeros(total, dtype=np.int64),
        body_m=np.concatenate([body for _, body, _ in rows]),
        label=tuple(item.file for item, _, pixel in rows for _ in pixel),
    )


def find_lamp(grey: ImageArray) -> FloatArray | str:
    """Return the centroid (2,) of the brightest compact blob of a grey picture (h, w), or why there is none.

    The centroid is weighted by the level above the surroundings; a smooth background is subtracted first.
    """
    picture = grey.astype(np.float32)
    raised = picture - cv2.medianBlur(grey, 31).astype(np.float32)
    scatter = 1.4826 * float(np.median(np.abs(raised - np.median(raised))))
    smooth = cv2.GaussianBlur(raised, (0, 0), 1.0)
    peak = float(smooth.max())
    if peak < max(_LEAST_GREY, _LAMP_SIGMAS * scatter):
        return "no bright spot"
    count, labels, boxes, _ = cv2.connectedComponentsWithStats((smooth > _LAMP_SHARE_OF_PEAK * peak).astype(np.uint8))
    peaks = np.array([smooth[labels == k].max() if boxes[k, cv2.CC_STAT_AREA] else 0.0 for k in range(1, count)])
    order = np.argsort(-peaks)
    best = int(order[0]) + 1
    if len(order) > 1 and peaks[order[1]] > _RIVAL * peaks[order[0]]:
        return "two or more lights as bright as each other"
    x, y, w, h, area = (int(v) for v in boxes[best])
    if max(w, h) > _LARGEST_LAMP * max(grey.shape) + 12 or area < _LEAST_FILL * w * h:
        return "a bright patch that is no lamp: large or not round"
    if x == 0 or y == 0 or x + w == grey.shape[1] or y + h == grey.shape[0]:
        return "a light cut by the picture's border"
    margin = 3
    rows, columns = slice(max(y - margin, 0), y + h + margin), slice(max(x - margin, 0), x + w + margin)
    weight = np.maximum(raised[rows, columns] - 3.0 * scatter, 0.0).astype(np.float64)
    v, u = np.mgrid[rows, columns]
    v, u = v[: weight.shape[0], : weight.shape[1]], u[: weight.shape[0], : weight.shape[1]]
    return np.array([float((weight * u).sum()), float((weight * v).sum())]) / weight.sum()


def _grey(folder: Path, item: _ListedPicture, rig: Rig) -> ImageArray:
    decoded = read_image(folder / item.file)
    where = f"{folder.name}/{item.file}"
    if not isinstance(decoded, np.ndarray):
        raise InputError(where, got="nothing that can be decoded", wanted="a picture, as stated in pictures.csv")
    w, h = rig[item.station].lens.image_size_px
    if decoded.shape[:2] != (h, w):
        got = f"{decoded.shape[1]}x{decoded.shape[0]} px"
        raise InputError(where, got=got, wanted=f"{w}x{h} px, as stated in the rig for {item.station}")
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def _read_table(folder: Path, rig: Rig) -> list[_ListedPicture]:
    if not folder.is_dir():
        raise InputError(str(folder), got="no such folder", wanted="a folder of pictures with pictures.csv")
    table = CsvTable(folder / "pictures.csv", PICTURE_COLUMNS)
    listed: list[_ListedPicture] = []
    last: dict[str, _ListedPicture] = {}
    for row in table:
        if len(listed) == MAX_PICTURES:
            raise table.fault(row.line, got="one more row", wanted=f"at most {MAX_PICTURES} pictures")
        item = _item(table, row, rig, last)
        last[item.station] = item
        listed.append(item)
    if not listed:
        raise SessionError("pictures.csv", got="no row", wanted="a row for each picture")
    return listed


def _item(table: CsvTable, row: Row, rig: Rig, last: dict[str, _ListedPicture]) -> _ListedPicture:
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
    return _ListedPicture(file=file, station=station, reading_deg=reading, sense=(senses[0], senses[1]), line=row.line)
