"""A board's corners in one picture, to a fraction of a pixel, and the sharpness of the picture there."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from calibration.lens.boards import CalibrationBoard
from groundstation.arrays import FloatArray, ImageArray

# a homography has 8 unknowns: 4 corners contain no information on the lens, twice as many some
FEWEST_CORNERS = 8
# half the window that a chessboard's saddle point is fitted in, parts of a square
_WINDOW = 0.25
_REFINED = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 60, 1e-4)
_CHESSBOARD_FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoardView:
    """The corners detected in one picture.

    Attributes
    ----------
    name : the picture's, for the user.
    ids : (n,) indices into ``CalibrationBoard.corners_m``.
    board_m : (n, 3) the corners on the board, in m.
    pixel : (n, 2) their pixels, px.
    edge_px : width of the edges next to the corners, px (median); a sharp picture has about 2.
    """

    name: str
    ids: Any
    board_m: FloatArray
    pixel: FloatArray
    edge_px: float


class CornerFinder:
    """Finds one kind of board in grey pictures; keeps OpenCV's detector between them."""

    def __init__(self, board: CalibrationBoard) -> None:
        self.board = board
        self._corners_m = board.corners_m
        self._charuco = cv2.aruco.CharucoDetector(board.opencv()) if board.kind == "charuco" else None

    def find(self, name: str, grey: ImageArray) -> BoardView | None:
        """Return the board's corners in a grey picture (h, w); None where there is no corner of it."""
        ids, pixel = self._chessboard(grey) if self._charuco is None else self._markers(self._charuco, grey)
        if not len(ids):
            return None
        return BoardView(name=name, ids=ids, board_m=self._corners_m[ids], pixel=pixel, edge_px=edge_width(grey, pixel))

    def _chessboard(self, grey: ImageArray) -> tuple[Any, FloatArray]:
        size = (self.board.columns, self.board.rows)
        found, pixel = cv2.findChessboardCornersSB(grey, size, flags=_CHESSBOARD_FLAGS)
        if not found:
            return np.zeros(0, dtype=np.intp), np.zeros((0, 2))
        # the search is robust and a twentieth of a pixel off; the saddle points themselves are three times as good
        start = np.asarray(pixel, dtype=np.float32).reshape(-1, 1, 2)
        half = int(np.clip(_WINDOW * _spacing(start.reshape(-1, 2).astype(np.float64)), 2, 10))
        pixel = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), _REFINED)
        return np.arange(len(self._corners_m)), np.asarray(pixel, dtype=np.float64).reshape(-1, 2)

    @staticmethod
    def _markers(detector: Any, grey: ImageArray) -> tuple[Any, FloatArray]:
        pixel, ids, _, _ = detector.detectBoard(grey)
        if ids is None:
            return np.zeros(0, dtype=np.intp), np.zeros((0, 2))
        return np.asarray(ids).reshape(-1).astype(np.intp), np.asarray(pixel, dtype=np.float64).reshape(-1, 2)


def other_chessboard(board: CalibrationBoard, grey: ImageArray) -> str:
    """Return the size of the chessboard that is in the picture after all, where the corners were miscounted."""
    if board.kind != "chessboard":
        return ""
    for more in (-1, 1, -2, 2):
        size = (board.columns + more, board.rows + more)
        if min(size) >= 3 and cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)[0]:
            return f"{size[0]}x{size[1]}"
    return ""


def _spacing(pixel: FloatArray) -> float:
    """Return the median distance of a corner (n, 2) from its nearest neighbour, px."""
    gaps = np.linalg.norm(pixel[:, None] - pixel[None], axis=2)
    np.fill_diagonal(gaps, np.inf)
    return float(np.median(gaps.min(axis=1)))


def edge_width(grey: ImageArray, pixel: FloatArray) -> float:
    """Return the median width of the edges at the corners (n, 2), px: contrast over steepest slope."""
    # the patch must hold the blurred edge and no other corner
    half = int(np.clip(0.45 * _spacing(pixel), 3, 25)) if len(pixel) > 1 else 6
    widths = []
    for u, v in np.round(pixel).astype(int):
        patch = grey[max(v - half, 0) : v + half + 1, max(u - half, 0) : u + half + 1].astype(np.float32)
        if min(patch.shape) < 4:
            continue
        # Sobel's kernel sums to 8 per unit of slope
        slope = np.hypot(cv2.Sobel(patch, cv2.CV_32F, 1, 0), cv2.Sobel(patch, cv2.CV_32F, 0, 1)) / 8.0
        steepest = float(np.percentile(slope, 98))
        contrast = float(np.percentile(patch, 95) - np.percentile(patch, 5))
        if steepest > 0:
            widths.append(contrast / steepest)
    return float(np.median(widths)) if widths else float("inf")
