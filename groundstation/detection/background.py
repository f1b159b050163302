"""What lies behind the target, learnt from earlier frames: a few of their surroundings of it, shifted into place.

The camera turns about a point close to its centre, so over the region of interest the scene moves as a whole:
one shift, found on the scene's own texture with the target left out, brings an old frame under the new one.
Frames are kept at moments between which the target moved against the scene, so that what one of them hides
another one shows. Where no kept frame knows the scene, the caller falls back on the spatial background.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import ImageArray
from groundstation.detection.flatten import Planes, planes
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
from groundstation.picture import Picture, grown

Float32Array = NDArray[np.float32]
Weights = tuple[np.float32, np.float32, np.float32, np.float32]

_KEPT = 6
# how far around the region of interest the scene is kept: the target moves on, and the camera turns
KEPT_MARGIN_PX = 48
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


@njit(cache=True, nogil=True)
def _unexplained(within: Box, misfit: Float32Array) -> NDArray[np.int32]:
    """Return the places (n, 2), row and column, in a part x0, y0, x1, y1 of the window that no frame fits well yet."""
    x0, y0, x1, y1 = within
    places = np.empty((max(x1 - x0, 0) * max(y1 - y0, 0), 2), np.int32)
    n = 0
    for i in range(y0, y1):
        for j in range(x0, x1):
            places[n, 0], places[n, 1] = i, j
            n += misfit[i, j] >= _GOOD_FIT
    return places[:n]


@njit(cache=True, nogil=True, fastmath=True)
def _difference(
    image: ImageArray,
    corner: tuple[int, int],
    places: NDArray[np.int32],
    frame: ImageArray,
    shift: tuple[float, float],
    hidden: Box,
    edge_px: float,
    residual: Float32Array,
    edge: Float32Array,
    misfit: Float32Array,
) -> NDArray[np.int32]:
    """Compare ``places`` of the window with one kept frame, and return those that it does not fit well, either.

    ``corner`` is the window's place in the image. Each pixel takes the frame that fits it best: what one frame shows
    of a passing bird is not background.
    """
    height, width = frame.shape[:2]
    ox, oy = math.floor(shift[0]), math.floor(shift[1])
    fx, fy = np.float32(shift[0] - ox), np.float32(shift[1] - oy)
    one, half = np.float32(1), np.float32(0.5)
    weights = ((one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy)
    x0, y0 = corner[0] + ox, corner[1] + oy
    gain = half * np.float32(edge_px)
    left = 0
    for n in range(places.shape[0]):
        i, j = places[n, 0], places[n, 1]
        x, y = x0 + j, y0 + i
        inside = 0 <= x < width - 1 and 0 <= y < height - 1
        if inside and not (hidden[1] <= y + fy < hidden[3] and hidden[0] <= x + fx < hidden[2]):
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
        if misfit[i, j] >= _GOOD_FIT:
            places[left, 0], places[left, 1] = i, j
            left += 1
    return places[:left]


@njit(cache=True, nogil=True, fastmath=True)
def _compare(
    window: Planes,
    ground: Planes,
    between: tuple[float, float],
    edge_px: float,
    shown: tuple[Box, Box],
    residual: Float32Array,
    edge: Float32Array,
    misfit: Float32Array,
) -> None:
    """Write the difference of a window (h, w) from a frame's planes (h + 1, w + 1), taken between their pixels.

    ``between`` is how far right and down of each of the frame's pixels, ``shown`` the part of the window that the frame
    shows and the hole in it that the target hides; elsewhere the misfit is unknown. Each channel is gone through on its
    own and row by row, so that the compiler works on many pixels at a time.
    """
    valid, hole = shown
    h, w = edge.shape
    fx, fy, one = np.float32(between[0]), np.float32(between[1]), np.float32(1)
    w00, w01, w10, w11 = (one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy
    gain = np.float32(0.5 * edge_px)
    apart = np.empty((3, w), np.float32)
    for i in range(h):
        steep = edge[i]
        steep[:] = 0.0
        for c in range(3):
            new, upper, lower = window[c][i], ground[c][i], ground[c][i + 1]
            for j in range(w):
                a, b = np.float32(upper[j]), np.float32(upper[j + 1])
                d, f = np.float32(lower[j]), np.float32(lower[j + 1])
                apart[c, j] = np.float32(new[j]) - (w00 * a + w01 * b + w10 * d + w11 * f)
                steep[j] = max(steep[j], gain * (abs(b - a) + abs(f - d) + abs(d - a) + abs(f - b)))
        grey, blue_red, magenta, unfit = residual[0, i], residual[1, i], residual[2, i], misfit[i]
        for j in range(w):
            b, g, r = apart[0, j], apart[1, j], apart[2, j]
            level = np.float32(0.114) * b + np.float32(0.587) * g + np.float32(0.299) * r
            one_colour, other_colour = np.float32(0.5) * (b - r), np.float32(0.5) * g - np.float32(0.25) * (b + r)
            grey[j], blue_red[j], magenta[j] = level, one_colour, other_colour
            unfit[j] = abs(level) + np.float32(2) * (abs(one_colour) + abs(other_colour))
        if not valid[1] <= i < valid[3]:
            unfit[:] = np.float32(_UNKNOWN)
        unfit[: valid[0]] = np.float32(_UNKNOWN)
        unfit[max(valid[2], 0) :] = np.float32(_UNKNOWN)
        if hole[1] <= i < hole[3]:
            unfit[max(hole[0], 0) : max(hole[2], 0)] = np.float32(_UNKNOWN)


def _cut(frame: ImageArray, x: int, y: int, size: tuple[int, int]) -> Planes:
    """Return the planes of a window (w, h) of a frame whose upper-left corner is (x, y); black beyond the frame."""
    w, h = size
    inside = frame[max(y, 0) : max(y + h, 0), max(x, 0) : max(x + w, 0)]
    if inside.shape[:2] == (h, w):
        return planes(inside)
    window = np.zeros((h, w, 3), np.uint8)
    top, left = max(-y, 0), max(-x, 0)
    if inside.size:
        window[top : top + inside.shape[0], left : left + inside.shape[1]] = inside
    return planes(window)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A part (h, w, 3) of an earlier frame, with its corner in it, px."""

    image: ImageArray
    corner: tuple[int, int]


class BackgroundMemory:
    """Parts of earlier frames of one camera with the target's place in each, and their shift to the newest image."""

    def __init__(self) -> None:
        self._frames: dict[int, _Seen] = {}
        self._hidden = np.zeros((_KEPT, 4), np.int64)
        self._shifts = np.zeros((_KEPT, 2))
        self._order: list[int] = []
        self._motion = np.zeros(2)
        self._age = 0
        self._edge_px = MAX_EDGE_PX

    def copy(self) -> "BackgroundMemory":
        """Return the same memory, to be changed apart; the images are shared."""
        other = BackgroundMemory()
        other._frames, other._order = dict(self._frames), list(self._order)
        other._hidden, other._shifts, other._motion = self._hidden.copy(), self._shifts.copy(), self._motion.copy()
        other._age, other._edge_px = self._age, self._edge_px
        return other

    def reset(self) -> None:
        """Forget all frames."""
        self._order = []
        self._frames = {}
        self._motion = np.zeros(2)

    def subtract(
        self, picture: Picture, origin: tuple[int, int], size: tuple[int, int], target: Box
    ) -> Difference | None:
        """Return a window's difference from the learnt background, or None where none can be laid under it.

        ``origin`` and ``size`` place the window in ``picture``; ``target`` x0, y0, x1, y1 is where the target is
        expected; all in full-image px.
        """
        if not self._order:
            return None
        w, h = size
        # one pixel more all around: texture is told from the neighbours
        place = (*origin, origin[0] + w, origin[1] + h)
        part, corner = picture.window(picture.available(grown(place, 1)) or place)
        image = np.ascontiguousarray(part)
        inside = (origin[0] - corner[0], origin[1] - corner[1])
        if not self._register(_Seen(image, corner), inside, size, target):
            self.reset()
            return None
        residual = np.empty((3, h, w), np.float32)
        edge, misfit = np.empty((h, w), np.float32), np.empty((h, w), np.float32)
        frame, hidden, shift = self._laid_under(self._order[0], corner)
        x0, y0 = inside[0] + shift[0], inside[1] + shift[1]
        ground = _cut(frame, math.floor(x0), math.floor(y0), (w + 1, h + 1))
        window = planes(image[inside[1] : inside[1] + h, inside[0] : inside[0] + w])
        last = (math.floor(frame.shape[1] - 1 - x0), math.floor(frame.shape[0] - 1 - y0))
        valid = (max(math.ceil(-x0), 0), max(math.ceil(-y0), 0), min(last[0], w), min(last[1], h))
        top_left = (math.ceil(hidden[0] - x0), math.ceil(hidden[1] - y0))
        hole = (*top_left, math.ceil(hidden[2] - x0), math.ceil(hidden[3] - y0))
        between, out = (x0 - math.floor(x0), y0 - math.floor(y0)), (residual, edge, misfit)
        _compare(window, ground, between, self._edge_px, (valid, hole), *out)
        # older frames serve where the target may be, where the newest one hides the scene, and where it ends
        near = _union(
            (target[0] - origin[0], target[1] - origin[1], target[2] - origin[0], target[3] - origin[1]), hole, size
        )
        whole = (0, 0, w, h)
        open_px = _unexplained(near if valid == whole else whole, misfit)
        for k in self._order[1:]:
            frame, hidden, shift = self._laid_under(k, corner)
            open_px = _difference(image, inside, open_px, frame, shift, hidden, self._edge_px, *out)
        return Difference(residual=residual, edge=edge, known=misfit < _UNKNOWN)

    def _laid_under(self, k: int, corner: tuple[int, int]) -> tuple[ImageArray, Box, tuple[float, float]]:
        """Return a kept part, what the target hides of it, and the shift to it from a part at ``corner``."""
        kept, hidden = self._frames[k], self._hidden[k]
        (x, y), shift = kept.corner, self._shifts[k]
        hole = (int(hidden[0]) - x, int(hidden[1]) - y, int(hidden[2]) - x, int(hidden[3]) - y)
        return kept.image, hole, (float(shift[0]) + corner[0] - x, float(shift[1]) + corner[1] - y)

    def _register(self, seen: _Seen, inside: tuple[int, int], size: tuple[int, int], target: Box) -> bool:
        """Find the new image's shift to the newest kept frame and carry it over to the others."""
        x, y = seen.corner
        keep_out = (target[0] - x, target[1] - y, target[2] - x, target[3] - y)
        rows = textured(seen.image, inside, size, keep_out)
        if rows.shape[0] < MIN_TEXTURED:
            return False
        newest = self._order[0]
        reference, hidden, shift = self._laid_under(newest, seen.corner)
        start = (shift[0] + float(self._motion[0]), shift[1] + float(self._motion[1]))
        sx, sy, sigma = refine(rows, reference, hidden, *start)
        if sigma > _MAX_SHIFT_SIGMA_PX or mean_misfit(rows, reference, hidden, sx, sy, 1) > _MAX_MISFIT:
            cx, cy = coarse(rows, reference, hidden, *start)
            sx, sy, sigma = refine(rows, reference, hidden, cx, cy)
            if sigma > _MAX_SHIFT_SIGMA_PX or mean_misfit(rows, reference, hidden, sx, sy, 1) > _MAX_MISFIT:
                return False
        self._edge_px = misplacement(rows, reference, hidden, sx, sy)
        self._motion = np.array([sx - shift[0], sy - shift[1]])
        self._shifts += self._motion
        return True

    def remember(self, picture: Picture, around: Box, target: Box, span_px: float) -> None:
        """Keep what is ``around`` if the target, within ``target``, has moved against the scene since the last time."""
        self._age += 1
        if self._order:
            newest = self._order[0]
            old = self._hidden[newest]
            moved = np.array([target[0] - old[0], target[1] - old[1]]) + self._shifts[newest]
            if float(np.hypot(*moved)) < _MOVED_PER_SPAN * span_px and self._age < _MAX_AGE:
                return
        free = [k for k in range(_KEPT) if k not in self._order]
        slot = free[0] if free else self._order.pop()
        image, corner = picture.window(picture.available(grown(around, KEPT_MARGIN_PX)) or around)
        self._frames[slot] = _Seen(image.copy(), corner)
        self._hidden[slot] = target
        self._shifts[slot] = 0.0
        self._order.insert(0, slot)
        self._age = 0


def _union(a: Box, b: Box, size: tuple[int, int]) -> Box:
    """Return the box that holds two boxes, within a window of this size."""
    x0, y0 = max(min(a[0], b[0]), 0), max(min(a[1], b[1]), 0)
    return x0, y0, min(max(a[2], b[2]), size[0]), min(max(a[3], b[3]), size[1])
