"""What lies behind the target, learnt from earlier frames: a few whole frames, shifted into place.

The camera turns about a point close to its centre, so over the region of interest the scene moves as a whole:
one shift, found on the scene's own texture with the target left out, brings an old frame under the new one.
Frames are kept at moments between which the target moved against the scene, so that what one of them hides
another one shows. Where no kept frame knows the scene, the caller falls back on the spatial background.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import ImageArray
from groundstation.detection.flatten import Plane, opponents, planes
from groundstation.detection.registration import (
    MAX_EDGE_PX,
    MIN_TEXTURED,
    Box,
    coarse,
    mean_misfit,
    misplacement,
    refine,
    textured,
)

Float32Array = NDArray[np.float32]
Weights = tuple[np.float32, np.float32, np.float32, np.float32]

_KEPT = 6
_MOVED_PER_SPAN = 0.25
_MAX_AGE = 60  # frames without a new one
_MAX_SHIFT_SIGMA_PX = 0.1
_MAX_MISFIT = 6.0  # grey levels, mean over the textured pixels
_GOOD_FIT = 8.0  # grey levels: no need to look at older frames
_UNKNOWN = 1e9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Difference:
    """The image minus the learnt background.

    ``residual`` (3, h, w) float32 as in `flatten`, ``edge`` (h, w) float32 the residual that misplacement
    alone may cause, ``known`` (h, w) where the background is known.
    """

    residual: Float32Array
    edge: Float32Array
    known: NDArray[np.bool_]


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def _against(
    image: ImageArray, at: tuple[int, int], frame: ImageArray, x: int, y: int, weights: Weights, c: int
) -> tuple[np.float32, np.float32]:
    """Return one channel's difference from a frame between its pixels, and the frame's slope there."""
    a, b = np.float32(frame[y, x, c]), np.float32(frame[y, x + 1, c])
    d, f = np.float32(frame[y + 1, x, c]), np.float32(frame[y + 1, x + 1, c])
    value = weights[0] * a + weights[1] * b + weights[2] * d + weights[3] * f
    return np.float32(image[at[1], at[0], c]) - value, abs(b - a) + abs(f - d) + abs(d - a) + abs(f - b)


@njit(cache=True, nogil=True, fastmath=True)
def _difference(
    image: ImageArray,
    corner: tuple[int, int],
    within: Box,
    frame: ImageArray,
    shift: tuple[float, float],
    hidden: Box,
    edge_px: float,
    residual: Float32Array,
    edge: Float32Array,
    misfit: Float32Array,
) -> None:
    """Compare a part of the window with one kept frame, wherever no other frame has fitted well so far.

    ``corner`` is the window's place in the image, ``within`` x0, y0, x1, y1 the part, in the window. Each pixel
    takes the frame that fits it best: what one frame shows of a passing bird is not background.
    """
    height, width = frame.shape[:2]
    ox, oy = math.floor(shift[0]), math.floor(shift[1])
    fx, fy = np.float32(shift[0] - ox), np.float32(shift[1] - oy)
    one, half = np.float32(1), np.float32(0.5)
    weights = ((one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy)
    x0, y0 = corner[0] + ox, corner[1] + oy
    gain = half * np.float32(edge_px)
    for i in range(max(within[1], -y0), min(within[3], height - 1 - y0)):
        y = y0 + i
        row_hidden = hidden[1] <= y + fy < hidden[3]
        for j in range(max(within[0], -x0), min(within[2], width - 1 - x0)):
            x = x0 + j
            if misfit[i, j] < _GOOD_FIT or (row_hidden and hidden[0] <= x + fx < hidden[2]):
                continue
            at = (corner[0] + j, corner[1] + i)
            blue, slope_0 = _against(image, at, frame, x, y, weights, 0)
            green, slope_1 = _against(image, at, frame, x, y, weights, 1)
            red, slope_2 = _against(image, at, frame, x, y, weights, 2)
            grey = np.float32(0.114) * blue + np.float32(0.587) * green + np.float32(0.299) * red
            blue_red, magenta = half * (blue - red), half * green - half * half * (blue + red)
            fit = abs(grey) + np.float32(2) * (abs(blue_red) + abs(magenta))
            if fit < misfit[i, j]:
                misfit[i, j] = fit
                residual[0, i, j], residual[1, i, j], residual[2, i, j] = grey, blue_red, magenta
                edge[i, j] = gain * max(slope_0, slope_1, slope_2)


@njit(cache=True, nogil=True, fastmath=True)
def _steepness(plane: Plane, gain: float, edge: Float32Array) -> None:
    """Raise ``edge`` to the plane's slope times ``gain``, inside its rim."""
    scale = np.float32(0.5 * gain)
    for i in range(1, plane.shape[0] - 1):
        for j in range(1, plane.shape[1] - 1):
            across = abs(np.int32(plane[i, j + 1]) - np.int32(plane[i, j - 1]))
            down = abs(np.int32(plane[i + 1, j]) - np.int32(plane[i - 1, j]))
            edge[i, j] = max(edge[i, j], scale * np.float32(across + down))


@njit(cache=True, nogil=True, fastmath=True)
def _weigh(residual: Float32Array, valid: Box, hole: Box, misfit: Float32Array) -> None:
    """Write how badly a frame fits, where it is ``valid`` and does not show the target (``hole``)."""
    for i in range(valid[1], valid[3]):
        for j in range(valid[0], valid[2]):
            misfit[i, j] = abs(residual[0, i, j]) + np.float32(2) * (abs(residual[1, i, j]) + abs(residual[2, i, j]))
    for i in range(max(hole[1], 0), min(hole[3], misfit.shape[0])):
        for j in range(max(hole[0], 0), min(hole[2], misfit.shape[1])):
            misfit[i, j] = np.float32(_UNKNOWN)


class BackgroundMemory:
    """Whole frames of one camera with the target's place in each, and their shift to the newest image.

    The images are kept as they were handed over, not copied: nobody writes into a frame.
    """

    def __init__(self) -> None:
        self._frames: dict[int, ImageArray] = {}
        self._hidden = np.zeros((_KEPT, 4), np.int64)
        self._shifts = np.zeros((_KEPT, 2))
        self._order: list[int] = []
        self._motion = np.zeros(2)
        self._age = 0
        self._edge_px = MAX_EDGE_PX

    def reset(self) -> None:
        """Forget all frames."""
        self._order = []
        self._frames = {}
        self._motion = np.zeros(2)

    def subtract(
        self, image: ImageArray, origin: tuple[int, int], size: tuple[int, int], target: Box
    ) -> Difference | None:
        """Return a window's difference from the learnt background, or None where none can be laid under it.

        ``origin`` and ``size`` place the window in ``image``; ``target`` x0, y0, x1, y1 is where the target is
        expected; all in full-image px.
        """
        if not self._order:
            return None
        if not self._register(image, origin, size, target):
            self.reset()
            return None
        w, h = size
        residual = np.zeros((3, h, w), np.float32)
        edge = np.zeros((h, w), np.float32)
        misfit = np.full((h, w), np.float32(_UNKNOWN))
        newest = self._order[0]
        dx, dy = float(self._shifts[newest, 0]), float(self._shifts[newest, 1])
        frame, hidden = self._frames[newest], _as_box(self._hidden[newest])
        x0, y0 = origin[0] + dx, origin[1] + dy
        under = np.array([[1.0, 0.0, x0], [0.0, 1.0, y0]])
        shifted = cv2.warpAffine(frame, under, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        window = image[origin[1] : origin[1] + h, origin[0] : origin[0] + w]
        ground = planes(shifted)
        opponents(planes(window), ground, residual)
        for plane in ground:
            _steepness(plane, self._edge_px, edge)
        last = (math.floor(frame.shape[1] - 1 - x0), math.floor(frame.shape[0] - 1 - y0))
        valid = (max(math.ceil(-x0), 0), max(math.ceil(-y0), 0), min(last[0], w), min(last[1], h))
        top_left = (math.ceil(hidden[0] - x0), math.ceil(hidden[1] - y0))
        hole = (*top_left, math.ceil(hidden[2] - x0), math.ceil(hidden[3] - y0))
        _weigh(residual, valid, hole, misfit)
        # older frames serve where the target may be, and where the newest one hides the scene
        near = _union(
            (target[0] - origin[0], target[1] - origin[1], target[2] - origin[0], target[3] - origin[1]), hole, size
        )
        for k in self._order[1:]:
            shift = (float(self._shifts[k, 0]), float(self._shifts[k, 1]))
            hidden = _as_box(self._hidden[k])
            _difference(image, origin, near, self._frames[k], shift, hidden, self._edge_px, residual, edge, misfit)
        return Difference(residual=residual, edge=edge, known=misfit < _UNKNOWN)

    def _register(self, image: ImageArray, origin: tuple[int, int], size: tuple[int, int], target: Box) -> bool:
        """Find the new image's shift to the newest kept frame and carry it over to the others."""
        rows = textured(image, origin, size, target)
        if rows.shape[0] < MIN_TEXTURED:
            return False
        newest = self._order[0]
        reference, hidden = self._frames[newest], _as_box(self._hidden[newest])
        start = self._shifts[newest] + self._motion
        sx, sy, sigma = refine(rows, reference, hidden, start[0], start[1])
        if sigma > _MAX_SHIFT_SIGMA_PX or mean_misfit(rows, reference, hidden, sx, sy, 1) > _MAX_MISFIT:
            cx, cy = coarse(rows, reference, hidden, start[0], start[1])
            sx, sy, sigma = refine(rows, reference, hidden, cx, cy)
            if sigma > _MAX_SHIFT_SIGMA_PX or mean_misfit(rows, reference, hidden, sx, sy, 1) > _MAX_MISFIT:
                return False
        self._edge_px = misplacement(rows, reference, hidden, sx, sy)
        self._motion = np.array([sx, sy]) - self._shifts[newest]
        self._shifts += self._motion
        return True

    def remember(self, image: ImageArray, target: Box, span_px: float) -> None:
        """Keep this image if the target, within ``target``, has moved against the scene since the last one kept."""
        self._age += 1
        if self._order:
            newest = self._order[0]
            old = self._hidden[newest]
            moved = np.array([target[0] - old[0], target[1] - old[1]]) + self._shifts[newest]
            if float(np.hypot(*moved)) < _MOVED_PER_SPAN * span_px and self._age < _MAX_AGE:
                return
        if self._order and self._frames[self._order[0]].shape != image.shape:
            self._order = []
        free = [k for k in range(_KEPT) if k not in self._order]
        slot = free[0] if free else self._order.pop()
        self._frames[slot] = image
        self._hidden[slot] = target
        self._shifts[slot] = 0.0
        self._order.insert(0, slot)
        self._age = 0


def _union(a: Box, b: Box, size: tuple[int, int]) -> Box:
    """Return the box that holds two boxes, within a window of this size."""
    x0, y0 = max(min(a[0], b[0]), 0), max(min(a[1], b[1]), 0)
    return x0, y0, min(max(a[2], b[2]), size[0]), min(max(a[3], b[3]), size[1])


def _as_box(row: NDArray[np.int64]) -> Box:
    return int(row[0]), int(row[1]), int(row[2]), int(row[3])
