"""Initial contour of the level set: the last silhouette moved to the prediction, or an ellipse of the expected size."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, MaskArray
from groundstation.detection.working_image import UNKNOWN_SPAN_PX, WorkingImage

_HEIGHT_PER_SPAN = 0.5
_MOST_GROWTH = 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreviousSilhouette:
    """The last silhouette: ``mask`` (h, w) uint8 of 0 and 1, the target point (2,) in it, its width; all in its px.

    ``scale`` is the number of full-image px in one of these.
    """

    mask: NDArray[np.uint8]
    point: FloatArray
    width: float
    scale: float


@njit(cache=True, nogil=True)
def _ellipse(shape: tuple[int, int], centre: FloatArray, half: tuple[float, float]) -> MaskArray:
    """Return the pixels within an axis-parallel ellipse."""
    h, w = shape
    inside = np.zeros(shape, np.bool_)
    for i in range(max(math.ceil(centre[1] - half[1]), 0), min(math.floor(centre[1] + half[1]) + 1, h)):
        y = (i - centre[1]) / half[1]
        reach = half[0] * math.sqrt(max(1.0 - y * y, 0.0))
        for j in range(max(math.ceil(centre[0] - reach), 0), min(math.floor(centre[0] + reach) + 1, w)):
            inside[i, j] = True
    return inside


@njit(cache=True, nogil=True)
def _moved(
    shape: tuple[int, int], mask: NDArray[np.uint8], point: FloatArray, to: FloatArray, growth: float
) -> MaskArray:
    """Return a mask scaled by ``growth`` about its point, which moves to ``to``; nearest neighbour."""
    h, w = shape
    inside = np.zeros(shape, np.bool_)
    top, bottom = to[1] - growth * (point[1] + 0.5), to[1] + growth * (mask.shape[0] - point[1])
    left, right = to[0] - growth * (point[0] + 0.5), to[0] + growth * (mask.shape[1] - point[0])
    # which column of the mask each column shows is the same in every row; −1 for none
    first = max(math.floor(left), 0)
    last = max(min(math.ceil(right) + 1, w), first)
    columns = np.empty(last - first, np.int64)
    for j in range(first, last):
        x = round((j - to[0]) / growth + point[0])
        columns[j - first] = x if 0 <= x < mask.shape[1] else -1
    for i in range(max(math.floor(top), 0), min(math.ceil(bottom) + 1, h)):
        y = round((i - to[1]) / growth + point[1])
        if not 0 <= y < mask.shape[0]:
            continue
        own, row = inside[i], mask[y]
        for j in range(first, last):
            if columns[j - first] >= 0:
                own[j] = row[columns[j - first]] > 0
    return inside


def start_contour(working: WorkingImage, last: PreviousSilhouette | None) -> MaskArray:
    """Return the inside of the start contour, (h, w) of the working image.

    The last silhouette is scaled to the expected span and dilated by the prediction's sigma, so that it contains the
    target wherever it is likely.
    """
    shape = working.image.shape[0], working.image.shape[1]
    if last is None:
        half = 0.5 * (working.span if working.span is not None else UNKNOWN_SPAN_PX)
        return _ellipse(shape, working.predicted, (half, _HEIGHT_PER_SPAN * half))
    growth = last.scale / working.scale
    if working.span is not None:
        growth *= min(max(working.span / (last.width * growth), 1.0 / _MOST_GROWTH), _MOST_GROWTH)
    sigma = math.sqrt(max(float(working.covariance[0, 0]), float(working.covariance[1, 1]))) / growth
    margin = min(math.ceil(sigma), math.ceil(last.width))
    mask = cv2.copyMakeBorder(last.mask, margin, margin, margin, margin, cv2.BORDER_CONSTANT)
    mask = cv2.dilate(mask, np.ones((2 * margin + 1, 2 * margin + 1), np.uint8))
    return _moved(shape, np.asarray(mask, np.uint8), last.point + margin, working.predicted, growth)
