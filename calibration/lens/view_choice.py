"""Choice of views for a calibration: sharp and as different as possible; each with a reason."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import cv2
import numpy as np

from calibration.lens.boards import CalibrationBoard
from calibration.lens.corners import FEWEST_CORNERS, BoardView
from groundstation.arrays import FloatArray

MOST_VIEWS = 40
# similar: the board's outline is at the same place within this part of the image's diagonal
_ALIKE = 0.02
# blurred: edges wider than this, and clearly wider than in the other pictures
_BLURRED_PX = 3.5
_BLURRED_RATIO = 1.6


class Choice(Enum):
    """What became of a picture."""

    USED = "used"
    NO_BOARD = "no board found"
    FEW_CORNERS = "too few corners"
    BLURRED = "blurred"
    ALIKE = "nearly the same as another"
    ENOUGH = "others show more"
    MISFIT = "does not fit the others"


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewVerdict:
    """One picture's ``name``, what became of it, and a ``detail`` in words (may be empty)."""

    name: str
    choice: Choice
    detail: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChosenViews:
    """The ``views`` to use, the most informative first, and a verdict on each offered view."""

    views: tuple[BoardView, ...]
    verdicts: tuple[ViewVerdict, ...]


def choose_views(
    found: Sequence[BoardView], board: CalibrationBoard, image_size_px: tuple[int, int], most: int = MOST_VIEWS
) -> ChosenViews:
    """Drop views with few corners, blurred ones and near-duplicates; of the rest take up to ``most``, all different."""
    verdicts = []
    enough = []
    for view in found:
        spread = np.linalg.svd(view.board_m[:, :2] - view.board_m[:, :2].mean(axis=0), compute_uv=False)
        if len(view.ids) < FEWEST_CORNERS or spread[1] < 0.5 * board.square_m:
            verdicts.append(_verdict(view, Choice.FEW_CORNERS, f"{len(view.ids)} of them, or all in a row"))
        else:
            enough.append(view)
    usual = float(np.median([v.edge_px for v in enough])) if enough else 0.0
    sharp = []
    for view in enough:
        if view.edge_px > max(_BLURRED_PX, _BLURRED_RATIO * usual):
            verdicts.append(_verdict(view, Choice.BLURRED, f"edges of {view.edge_px:.1f} px; usual here {usual:.1f}"))
        else:
            sharp.append(view)
    order, marks = _farthest_first(sharp, board, image_size_px, most)
    verdicts += marks
    chosen = tuple(sharp[i] for i in order)
    verdicts += [_verdict(view, Choice.USED, f"{len(view.ids)} corners") for view in chosen]
    place = {view.name: i for i, view in enumerate(found)}
    return ChosenViews(views=chosen, verdicts=tuple(sorted(verdicts, key=lambda v: place[v.name])))


def _verdict(view: BoardView, choice: Choice, detail: str) -> ViewVerdict:
    return ViewVerdict(name=view.name, choice=choice, detail=detail)


def _farthest_first(
    views: Sequence[BoardView], board: CalibrationBoard, image_size_px: tuple[int, int], most: int
) -> tuple[list[int], list[ViewVerdict]]:
    """Return the order of taking, each the least like all before it, and verdicts on those not taken."""
    if not views:
        return [], []
    features = np.array([_place(view, board, image_size_px) for view in views])
    # full and sharp boards go first
    first = int(np.argmax([len(v.ids) - 0.5 * v.edge_px for v in views]))
    taken = [first]
    distance = np.abs(features - features[first]).max(axis=1)
    nearest = np.full(len(views), first)
    while len(taken) < most:
        candidate = int(np.argmax(distance))
        if distance[candidate] < _ALIKE:
            break
        taken.append(candidate)
        new = np.abs(features - features[candidate]).max(axis=1)
        nearest = np.where(new < distance, candidate, nearest)
        distance = np.minimum(distance, new)
    marks = []
    for i in sorted(set(range(len(views))) - set(taken)):
        if distance[i] < _ALIKE:
            marks.append(_verdict(views[i], Choice.ALIKE, f"like {views[nearest[i]].name}"))
        else:
            marks.append(_verdict(views[i], Choice.ENOUGH, f"{most} views are used"))
    return taken, marks


def _place(view: BoardView, board: CalibrationBoard, image_size_px: tuple[int, int]) -> FloatArray:
    """Return the position of the board's outline (8,), in diagonals: place, distance, turn and tilt in one."""
    found: Any = cv2.findHomography(view.board_m[:, :2], view.pixel)
    homography = found[0]
    diagonal = float(np.hypot(*image_size_px))
    if homography is None:
        return np.tile(view.pixel.mean(axis=0), 4) / diagonal
    outline = cv2.perspectiveTransform(board.outline_m[:, None, :2], homography)
    return np.asarray(outline, dtype=np.float64).reshape(-1) / diagonal
