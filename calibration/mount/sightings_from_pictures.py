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
from calibration.picture_table import ListedPicture, read_picture_table
from groundstation.arrays import FloatArray, ImageArray
from groundstation.errors import InputError
from groundstation.rig.rig import Rig
from groundstation.session.media import read_image

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
    listed = read_picture_table(folder, rig)
    finder = CornerFinder(board) if board is not None else None
    rows: dict[str, list[tuple[ListedPicture, FloatArray, FloatArray]]] = {}
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


def _sightings(rows: Sequence[tuple[ListedPicture, FloatArray, FloatArray]], sigma_px: float) -> MountSightings:
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


def _grey(folder: Path, item: ListedPicture, rig: Rig) -> ImageArray:
    decoded = read_image(folder / item.file)
    where = f"{folder.name}/{item.file}"
    if not isinstance(decoded, np.ndarray):
        raise InputError(where, got="nothing that can be decoded", wanted="a picture, as stated in pictures.csv")
    w, h = rig[item.station].lens.image_size_px
    if decoded.shape[:2] != (h, w):
        got = f"{decoded.shape[1]}x{decoded.shape[0]} px"
        raise InputError(where, got=got, wanted=f"{w}x{h} px, as stated in the rig for {item.station}")
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
