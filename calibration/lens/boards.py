"""The board in front of the camera: chessboard or ChArUco, described in one word."""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from calibration.errors import IntrinsicsError
from groundstation.arrays import FloatArray
from groundstation.files.toml_table import quoted

WANTED = (
    "charuco:COLSxROWS:SQUARE_M:MARKER_M[:DICT] (squares) or chessboard:COLSxROWS:SQUARE_M (inner corners), "
    "as in charuco:8x6:0.04:0.03:DICT_4X4_50"
)
_MOST_SQUARES = 60
# a square longer than this was given in mm or cm
_SHORTEST_M, _LONGEST_M = 1e-4, 2.0
_DEFAULT_DICTIONARY = "DICT_4X4_50"


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationBoard:
    """A flat board.

    Attributes
    ----------
    kind : ``charuco`` or ``chessboard``.
    columns, rows : squares of a ChArUco board; inner corners of a chessboard, as OpenCV and Kalibr count them.
    square_m, marker_m : edges, in m; ``marker_m`` 0 for a chessboard.
    dictionary : OpenCV's name of the markers' dictionary, empty for a chessboard.
    """

    kind: str
    columns: int
    rows: int
    square_m: float
    marker_m: float = 0.0
    dictionary: str = ""

    @property
    def corners_m(self) -> FloatArray:
        """Return all inner corners (n, 3) in m in the board's frame, z = 0; a corner's number is its row."""
        columns, rows = (self.columns, self.rows) if self.kind == "chessboard" else (self.columns - 1, self.rows - 1)
        v, u = np.mgrid[0:rows, 0:columns]
        # OpenCV's ChArUco frame starts at the outer corner; starting both there costs nothing
        return self.square_m * np.stack([u.ravel() + 1.0, v.ravel() + 1.0, np.zeros(u.size)], axis=1)

    @property
    def outline_m(self) -> FloatArray:
        """Return the four outermost inner corners (4, 3) in m, in turn."""
        corners = self.corners_m
        (x0, y0), (x1, y1) = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        return np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])

    def opencv(self) -> Any:
        """Return OpenCV's own ChArUco board."""
        markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, markers)


def parse_board(text: str) -> CalibrationBoard:
    """Read a board's description.

    Raises
    ------
    IntrinsicsError : it is invalid, or describes an impossible board.
    """
    kind, *parts = text.strip().split(":")
    if kind not in ("charuco", "chessboard") or not (len(parts) in (3, 4) if kind == "charuco" else len(parts) == 2):
        raise _refused(text)
    try:
        columns, rows = (int(part) for part in parts[0].split("x"))
        lengths = [float(part) for part in parts[1:3]]
    except ValueError:
        raise _refused(text) from None
    if not all(math.isfinite(v) and _SHORTEST_M < v <= _LONGEST_M for v in lengths):
        wanted = f"edges in m, above {_SHORTEST_M:g} and up to {_LONGEST_M:g} (40 mm are 0.04)"
        raise IntrinsicsError("--board", got=quoted(text), wanted=wanted)
    if not 3 <= columns <= _MOST_SQUARES or not 3 <= rows <= _MOST_SQUARES:
        raise IntrinsicsError("--board", got=quoted(text), wanted=f"3 to {_MOST_SQUARES} columns and rows")
    if kind == "chessboard":
        return CalibrationBoard(kind=kind, columns=columns, rows=rows, square_m=lengths[0])
    if lengths[1] >= lengths[0]:
        raise IntrinsicsError("--board", got=quoted(text), wanted="a marker smaller than its square")
    name = parts[3] if len(parts) == 4 else _DEFAULT_DICTIONARY
    if not name.startswith("DICT_") or not hasattr(cv2.aruco, name):
        wanted = "a dictionary of OpenCV, as DICT_4X4_50, DICT_5X5_100 or DICT_APRILTAG_36h11"
        raise IntrinsicsError("--board", got=quoted(name), wanted=wanted)
    most = len(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)).bytesList)
    if columns * rows // 2 > most:
        wanted = f"at most {most} markers, which is what {name} has"
        raise IntrinsicsError("--board", got=f"{columns * rows // 2} markers", wanted=wanted)
    return CalibrationBoard(
        kind=kind, columns=columns, rows=rows, square_m=lengths[0], marker_m=lengths[1], dictionary=name
    )


def _refused(text: str) -> IntrinsicsError:
    return IntrinsicsError("--board", got=quoted(text), wanted=WANTED)
