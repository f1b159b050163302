"""Background model of the target's surroundings: parts of earlier frames, registered to the newest one.

The camera turns about a point close to its centre, so over the region of interest the scene moves as a whole:
one shift, found on the scene's own texture with the target left out, brings an old frame under the new one.
Frames are kept at times between which the target moved against the scene, so that an area hidden in one of them
is visible in another. Where no kept frame covers the scene, the caller falls back on the spatial background.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import ImageArray
from groundstation.box import Box, expand, shift, union
from groundstation.detection.flatten import Planes, planes
from groundstation.picture import Picture
from groundstation.registration.translation import (
    MAX_EDGE_PX,
    MIN_TEXTURED,
    coarse,
    grey_of,
    mean_misfit,
    misplacement,
    refine,
    textured,
)

Float32Array = NDArray[np.float32]
Float32Row = NDArray[np.float32]
Weights = tuple[np.float32, np.float32, np.float32, np.float32]

_KEPT = 6
# how far around the region of interest the scene is kept: the target moves on, and the camera turns
KEPT_MARGIN_PX = 48
_MOVED_PER_SPAN = 0.25
_MAX_AGE = 60  # frames without a new one
_MAX_SHIFT_SIGMA_PX = 0.1
_MAX_MISFIT = 6.0  # grey levels, mean over the textured pixels
_GOOD_FIT = 8.0  # grey levels: older frames are not needed
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
def _opponents(b: np.float32, g: np.float32, r: np.float32) -> tuple[np.float32, np.float32, np.float32]:
    """Return grey, blue minus red and green minus magenta of a colour, as in `flatten`."""
    half = np.float32(0.5)
    grey = np.float32(0.114) * b + np.float32(0.587) * g + np.float32(0.299) * r
    return grey, half * (b - r), half * g - half * half * (b + r)


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def _unlike(b: np.float32, g: np.float32, r: np.float32) -> np.float32:
    """Return how unlike the background a colour's difference from it is, grey levels."""
    grey, blue_red, magenta = _opponents(b, g, r)
    return abs(grey) + np.float32(2) * (abs(blue_red) + abs(magenta))


@njit(cache=True, nogil=True)
def _open(misfit: Float32Array, first: int, last: int) -> tuple[int, int]:
    """Return the part x0, x1 of a row, between two columns, that no frame fits well yet; x0 = x1 without one."""
    while first < last and misfit[first] < _GOOD_FIT:
        first += 1
    while last > first and misfit[last - 1] < _GOOD_FIT:
        last -= 1
    return first, last


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def _row_difference(
    window: Planes,
    frame: Planes,
    rows: tuple[int, int],
    columns: tuple[int, int],
    shift_x: int,
    weights: Weights,
    gain: np.float32,
    apart: Float32Array,
    steep: Float32Row,
) -> None:
    """Write the difference of a part of a window's row from a frame, and its possible part due to misplacement.

    ``rows`` are the row in the window and in the frame, ``columns`` the first and last of the window, which lie
    ``shift_x`` farther right in the frame; ``weights`` interpolate between its pixels. ``apart`` (3, w) and ``steep``
    (w,) are written from their first element on. Each channel is processed separately, so that the compiler vectorises
    the loop.
    """
    (i, y), (a, b) = rows, columns
    w00, w01, w10, w11 = weights
    first, last, n = shift_x + a, shift_x + b + 1, b - a
    steep[:n] = 0.0
    for c in range(3):
        new = window[c][i, a:b]
        upper, lower = frame[c][y, first:last], frame[c][y + 1, first:last]
        for j in range(n):
            p, q = np.float32(upper[j]), np.float32(upper[j + 1])
            r, s = np.float32(lower[j]), np.float32(lower[j + 1])
            apart[c, j] = np.float32(new[j]) - (w00 * p + w01 * q + w10 * r + w11 * s)
            steep[j] = max(steep[j], gain * (abs(q - p) + abs(s - r) + abs(r - p) + abs(s - q)))


@njit(cache=True, nogil=True, inline="always", fastmath=True)
def _keep_better(
    n: int,
    apart: Float32Array,
    steep: Float32Row,
    unfit: Float32Row,
    residual: tuple[Float32Row, Float32Row, Float32Row],
    edge: Float32Row,
    worst: Float32Row,
) -> None:
    """Write the difference of n pixels of a row where no frame fits well yet and this one, by ``unfit``, fits better.

    The rows of ``residual``, ``edge`` and ``worst``, the misfit, all (n,), contain the values of the frames before.
    """
    grey, blue_red, magenta = residual
    for j in range(n):
        better = worst[j] >= np.float32(_GOOD_FIT) and unfit[j] < worst[j]
        level, one_colour, other_colour = _opponents(apart[0, j], apart[1, j], apart[2, j])
        grey[j] = level if better else grey[j]
        blue_red[j] = one_colour if better else blue_red[j]
        magenta[j] = other_colour if better else magenta[j]
        edge[j] = steep[j] if better else edge[j]
        worst[j] = unfit[j] if better else worst[j]


@njit(cache=True, nogil=True, fastmath=True)
def _subtract_background(
    window: Planes,
    frame: Planes,
    offset: tuple[float, float],
    edge_px: float,
    within: Box[int],
    hole: Box[int],
    residual: Float32Array,
    edge: Float32Array,
    misfit: Float32Array,
) -> bool:
    """Write the difference of a window (h, w) from a kept frame where no frame fits well yet and this one fits better.

    ``offset`` (x, y) is the window's position in the frame, which is interpolated; ``within`` the part of the window to
    process, ``hole`` the area hidden by the target, in the frame's pixels. Returns whether a part is still without
    a frame that fits well. A passing bird in one frame is not background, hence each pixel uses the first
    frame that fits it well, or the one that fits best.
    """
    h, w = frame[0].shape
    offset_x, offset_y = offset
    ox, oy = math.floor(offset_x), math.floor(offset_y)
    fx, fy, one = np.float32(offset_x - ox), np.float32(offset_y - oy), np.float32(1)
    weights = (one - fx) * (one - fy), fx * (one - fy), (one - fx) * fy, fx * fy
    gain = np.float32(0.5 * edge_px)
    apart, steep = np.empty((3, edge.shape[1]), np.float32), np.empty(edge.shape[1], np.float32)
    unfit = np.empty(edge.shape[1], np.float32)
    # columns of the window that the frame shows, and of these the ones that the target hides
    shown_from, shown_to = max(-ox, 0), min(w - 1 - ox, edge.shape[1])
    hidden_from, hidden_to = math.ceil(hole.x0 - offset_x), math.ceil(hole.x1 - offset_x)
    unfinished = False
    for i in range(within.y0, within.y1):
        x0, x1 = _open(misfit[i], within.x0, within.x1)
        y = oy + i
        a, b = max(x0, shown_from), min(x1, shown_to)
        if a >= b or not 0 <= y < h - 1:
            unfinished = unfinished or x1 > x0
            continue
        n = b - a
        _row_difference(window, frame, (i, y), (a, b), ox, weights, gain, apart, steep)
        for j in range(n):
            unfit[j] = _unlike(apart[0, j], apart[1, j], apart[2, j])
        if hole.y0 <= y + fy < hole.y1:
            unfit[min(max(hidden_from - a, 0), n) : min(max(hidden_to - a, 0), n)] = np.float32(_UNKNOWN)
        parts = residual[0, i, a:b], residual[1, i, a:b], residual[2, i, a:b]
        _keep_better(n, apart, steep, unfit, parts, edge[i, a:b], misfit[i, a:b])
        x0, x1 = _open(misfit[i], x0, x1)
        unfinished = unfinished or x1 > x0
    return unfinished


@njit(cache=True, nogil=True)
def _clear_unknown(misfit: Float32Array, residual: Float32Array, edge: Float32Array) -> NDArray[np.bool_]:
    """Write zeros into the difference where no frame shows the background; return where one does (h, w)."""
    known = np.empty(misfit.shape, np.bool_)
    for i in range(misfit.shape[0]):
        own, unlike, unknown = known[i], misfit[i], 0
        for j in range(own.size):
            own[j] = unlike[j] < np.float32(_UNKNOWN)
            unknown += not own[j]
        if unknown == 0:
            continue
        grey, blue_red, magenta, steepness = residual[0, i], residual[1, i], residual[2, i], edge[i]
        for j in range(own.size):
            if not own[j]:
                grey[j] = blue_red[j] = magenta[j] = steepness[j] = 0.0
    return known


@dataclass(eq=False)
class _FramePart:
    """A part (h, w, 3) of an earlier frame, with its corner in it, px.

    It is a view of its frame until it is used; with sky behind the target it never is.
    """

    image: ImageArray
    corner: tuple[int, int]

    def own(self) -> None:
        """Copy it, unless that was done, and let the frame go."""
        if self.image.base is not None:
            self.image = self.image.copy()

    @cached_property
    def colour(self) -> Planes:
        """Its blue, green and red."""
        return planes(self.image)

    @cached_property
    def grey(self) -> Float32Array:
        """Its grey levels (h, w)."""
        return grey_of(self.image)


class BackgroundModel:
    """Parts of earlier frames of one camera with the target's place in each, and their shift to the newest image."""

    def __init__(self) -> None:
        self._frames: dict[int, _FramePart] = {}
        self._hidden: dict[int, Box[int]] = {}
        self._shifts = np.zeros((_KEPT, 2))
        self._order: list[int] = []
        self._motion = np.zeros(2)
        self._age = 0
        self._edge_px = MAX_EDGE_PX

    def copy(self) -> "BackgroundModel":
        """Return the same memory, to be changed apart; the images are shared."""
        other = BackgroundModel()
        other._frames, other._order = dict(self._frames), list(self._order)
        other._hidden, other._shifts, other._motion = dict(self._hidden), self._shifts.copy(), self._motion.copy()
        other._age, other._edge_px = self._age, self._edge_px
        return other

    def reset(self) -> None:
        """Forget all frames."""
        self._order = []
        self._frames = {}
        self._motion = np.zeros(2)

    def subtract(self, picture: Picture, window: Box[int], target: Box[int]) -> Difference | None:
        """Return a window's difference from the learnt background; None where that is not known.

        ``window`` and the box in which the ``target`` is expected are in full-image px.
        """
        if not self._order:
            return None
        w, h = window.size
        # one pixel more on each side: the gradient of a pixel needs its neighbours
        part, corner = picture.window(picture.available(expand(window, 1)) or window)
        image = np.ascontiguousarray(part)
        inside = shift(window, -corner[0], -corner[1])
        if not self._register(image, corner, inside, target):
            self.reset()
            return None
        colour = planes(image[inside.slices])
        residual, edge = np.empty((3, h, w), np.float32), np.empty((h, w), np.float32)
        misfit = np.full((h, w), _UNKNOWN, np.float32)
        within = Box(0, 0, w, h)
        for k in self._order:
            kept, hole, (sx, sy) = self._registered_part(k, corner)
            offset = (inside.x0 + sx, inside.y0 + sy)
            if not _subtract_background(
                colour, kept.colour, offset, self._edge_px, within, hole, residual, edge, misfit
            ):
                break
            if k == self._order[0] and _holds(kept.grey.shape, offset, window.size):
                # older frames serve where the target may be, where the newest one hides the scene, and where it ends
                x0, x1 = (math.ceil(x - offset[0]) for x in (hole.x0, hole.x1))
                y0, y1 = (math.ceil(y - offset[1]) for y in (hole.y0, hole.y1))
                x0, y0, x1, y1 = union(shift(target, -window.x0, -window.y0), Box(x0, y0, x1, y1))
                within = Box(max(x0, 0), max(y0, 0), min(x1, w), min(y1, h))
        return Difference(residual=residual, edge=edge, known=_clear_unknown(misfit, residual, edge))

    def _registered_part(self, k: int, corner: tuple[int, int]) -> tuple[_FramePart, Box[int], tuple[float, float]]:
        """Return a kept part, the area that the target hides in it, and the shift to it from a part at ``corner``."""
        kept, (sx, sy) = self._frames[k], self._shifts[k]
        x, y = kept.corner
        return kept, shift(self._hidden[k], -x, -y), (float(sx) + corner[0] - x, float(sy) + corner[1] - y)

    def _register(self, image: ImageArray, corner: tuple[int, int], inside: Box[int], target: Box[int]) -> bool:
        """Find the new image's shift to the newest kept frame and carry it over to the others."""
        rows = textured(image, inside, shift(target, -corner[0], -corner[1]))
        if rows.shape[0] < MIN_TEXTURED:
            return False
        newest = self._order[0]
        kept, hidden, known = self._registered_part(newest, corner)
        kept.own()
        reference = kept.grey
        start = (known[0] + float(self._motion[0]), known[1] + float(self._motion[1]))
        sx, sy, sigma = refine(rows, reference, hidden, *start)
        if sigma > _MAX_SHIFT_SIGMA_PX or mean_misfit(rows, reference, hidden, sx, sy, 1) > _MAX_MISFIT:
            cx, cy = coarse(rows, reference, hidden, *start)
            sx, sy, sigma = refine(rows, reference, hidden, cx, cy)
            if sigma > _MAX_SHIFT_SIGMA_PX or mean_misfit(rows, reference, hidden, sx, sy, 1) > _MAX_MISFIT:
                return False
        self._edge_px = misplacement(rows, reference, hidden, sx, sy)
        self._motion = np.array([sx - known[0], sy - known[1]])
        self._shifts += self._motion
        return True

    def remember(self, picture: Picture, around: Box[int], target: Box[int], span_px: float) -> None:
        """Store the area ``around`` if the target, within ``target``, has moved against the scene since then."""
        self._age += 1
        if self._order:
            newest = self._order[0]
            old = self._hidden[newest]
            moved = np.array([target.x0 - old.x0, target.y0 - old.y0]) + self._shifts[newest]
            if float(np.hypot(*moved)) < _MOVED_PER_SPAN * span_px and self._age < _MAX_AGE:
                return
            # at most one whole frame is held
            self._frames[newest].own()
        free = [k for k in range(_KEPT) if k not in self._order]
        slot = free[0] if free else self._order.pop()
        image, corner = picture.window(picture.available(expand(around, KEPT_MARGIN_PX)) or around)
        self._frames[slot] = _FramePart(image, corner)
        self._hidden[slot] = target
        self._shifts[slot] = 0.0
        self._order.insert(0, slot)
        self._age = 0


def _holds(shape: tuple[int, ...], offset: tuple[float, float], size: tuple[int, int]) -> bool:
    """Return whether a frame (h, w) shows all of a window (w, h) at that offset in it, between its pixels."""
    (x, y), (w, h) = offset, size
    return x >= 0 and y >= 0 and math.floor(x) + w < shape[1] and math.floor(y) + h < shape[0]
