"""Sky segmentation: smooth cells connected to the upper border, above the horizon if it is known."""

import math
from collections.abc import Callable

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray, MaskArray

CELL_PX = 8
_MAX_STEP = 10.0  # grey levels between neighbouring cells
_MAX_TEXTURE = 4.0  # grey levels, mean deviation from the local background
_MAX_HOLE = 0.25  # share of the picture: larger regions are not objects in the sky
_MIN_SHARE = 0.02  # of the picture: smaller patches of smoothness are not sky


def sky_cells(grey: ImageArray, texture: NDArray[np.float32], up: FloatArray | None) -> MaskArray:
    """Return the mask of sky cells, each about `CELL_PX` px wide.

    Parameters
    ----------
    grey : (h, w) working image.
    texture : (any size) local spread around the background, grey levels.
    up : (3,) so that up · (x, y, 1) > 0 for pixels of ``grey`` above the horizon, None if unknown.
    """
    h, w = grey.shape
    size = (max(w // CELL_PX, 1), max(h // CELL_PX, 1))
    # small objects in the sky must not divide it
    calm = cv2.medianBlur(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), 5)
    step = cv2.morphologyEx(calm, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    smooth = (step < _MAX_STEP) & (cv2.resize(texture, size, interpolation=cv2.INTER_LINEAR) < _MAX_TEXTURE)
    above: MaskArray | None = None
    if up is not None:
        x = (np.arange(size[0]) + 0.5) * (w / size[0]) - 0.5
        y = (np.arange(size[1]) + 0.5) * (h / size[1]) - 0.5
        above = np.asarray(up[0] * x[None, :] + up[1] * y[:, None] + up[2] > 0.0, np.bool_)
        smooth &= above
    top = np.zeros_like(smooth)
    top[0] = True
    sky = _regions(smooth, lambda found, area: _touching(found, area.size, top) & (area >= _MIN_SHARE * found.size))
    sky = np.asarray(
        cv2.dilate(sky.astype(np.uint8), np.ones((3, 3), np.uint8)), np.bool_
    )  # the gradient widens borders
    # a region that is not sky, does not reach the ground and is not huge is an object in the sky
    ground = np.zeros_like(sky)
    ground[-1] = True
    if above is not None:
        ground |= ~above
    rest = _regions(
        ~sky | ground, lambda found, area: ~_touching(found, area.size, ground) & (area <= _MAX_HOLE * found.size)
    )
    return np.asarray((sky | rest) & (True if above is None else above), np.bool_)


def _regions(mask: MaskArray, wanted: Callable[[NDArray[np.int32], NDArray[np.int64]], MaskArray]) -> MaskArray:
    """Return those connected regions of a mask that ``wanted`` chooses by label."""
    count, found = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4, ltype=cv2.CV_32S)
    labels = np.asarray(found, np.int32)
    chosen = wanted(labels, np.bincount(labels.ravel(), minlength=count))
    chosen[0] = False
    return np.asarray(chosen[labels], np.bool_)


def _touching(labels: NDArray[np.int32], count: int, where: MaskArray) -> MaskArray:
    """Return which of ``count`` labels occur where a mask is set."""
    touching = np.zeros(count, np.bool_)
    touching[labels[where]] = True
    return touching


@njit(cache=True)
def sky_around(sky: MaskArray, x0: float, y0: float, x1: float, y1: float) -> float:
    """Return the share of sky on the side of a box (in cells) that has the least of it.

    An object in the sky has sky on every side; one on the ground does not. Sides outside the picture
    do not count; without any the result is 0.
    """
    h, w = sky.shape
    margin = max(0.3 * max(x1 - x0, y1 - y0), 1.0)
    strips = (
        (x0 - margin, y0, x0, y1),
        (x1, y0, x1 + margin, y1),
        (x0, y0 - margin, x1, y0),
        (x0, y1, x1, y1 + margin),
    )
    least, any_side = 1.0, False
    for left, top, right, bottom in strips:
        a, b = max(math.floor(left), 0), max(math.floor(top), 0)
        c, d = min(math.ceil(right), w), min(math.ceil(bottom), h)
        if c <= a or d <= b:
            continue
        count = 0
        for i in range(b, d):
            for j in range(a, c):
                count += sky[i, j]
        least, any_side = min(least, count / ((c - a) * (d - b))), True
    return least if any_side else 0.0
