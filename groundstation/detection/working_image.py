"""Input of one detection: the hint, the working image of the region of interest, and the expected target in it."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box, box_of_size
from groundstation.detection.level_set_input import ExpectedTarget
from groundstation.picture import Picture, as_picture

UNKNOWN_SPAN_PX = 25.0
_LENGTH_PER_SPAN = 0.75
_CUT_ANYWHERE, _CUT_ACROSS = 0.05, 0.15
_MIN_SPAN_SIGMA = 0.02
_THICK_END_ON, _THICK_PER_LENGTH = 0.6, 0.6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DetectionHint:
    """Prediction of the filter for the detector.

    Attributes
    ----------
    predicted_px : (2,) expected target point in the full image.
    predicted_covariance_px2 : (2, 2) its covariance.
    expected_span_px : expected wing span in px, None if unknown.
    span_sigma_ratio : one sigma of the logarithm of the expected span.
    forward_px_per_m : (2,) image motion of a point 1 m further along the flight direction, None if unknown.
    forward_sigma_rad : one sigma of the flight direction; infinite where it does not say where the nose is.
    up_px_per_m : (2,) image of 1 m of runway-up at the target, None if unknown.
    px_per_m : scale at the target's range, None if unknown.
    height_m : of the target point above the runway, None if unknown; a rolling aircraft holds itself level.
    """

    predicted_px: FloatArray
    predicted_covariance_px2: FloatArray
    expected_span_px: float | None = None
    span_sigma_ratio: float = 0.7
    forward_px_per_m: FloatArray | None = None
    forward_sigma_rad: float = 0.0
    up_px_per_m: FloatArray | None = None
    px_per_m: float | None = None
    height_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorkingImage:
    """The working image of one frame: ``scale`` full-image px per working px, origin in the full image.

    ``offset`` (2,) is the full-image px of the working pixel 0, 0,
    ``forward`` and ``up`` (2,) are the image shift of one span's length along these directions, in spans;
    ``height_per_span`` is the height above the runway in spans.
    """

    roi: Box[int]
    scale: int
    image: ImageArray
    image_size_px: tuple[int, int]
    offset: FloatArray
    predicted: FloatArray
    covariance: FloatArray
    span: float | None
    span_sigma: float
    forward: FloatArray | None
    up: FloatArray | None
    height_per_span: float | None

    def full(self, point: FloatArray) -> FloatArray:
        """Map working pixels (..., 2) to the full image."""
        return np.asarray(point * self.scale + self.offset, np.float64)

    def open_edges(self) -> tuple[bool, bool, bool, bool]:
        """Return for left, top, right, bottom whether the image extends beyond the region of interest."""
        roi, (w, h) = self.roi, self.image_size_px
        return (roi.x0 > 0, roi.y0 > 0, roi.x1 + self.scale <= w, roi.y1 + self.scale <= h)

    def cuts(self, box: Box[int]) -> bool:
        """Return whether a box in working px touches the image border."""
        x0, y0, x1, y1 = box
        left, top, right, bottom = (not edge for edge in self.open_edges())
        h, w = self.image.shape[:2]
        return (left and x0 <= 0) or (top and y0 <= 0) or (right and x1 >= w) or (bottom and y1 >= h)

    def cut_covariance(self, box: Box[int]) -> FloatArray:
        """Return the covariance (2, 2) to add to the target point of a silhouette cut by the border, full-image px².

        The missing part may be the wider one, which gives an error in every direction; and the point is displaced
        with the centre of the visible part, across the border, by a share of the missing part.
        """
        x0, y0, x1, y1 = box
        left, top, right, bottom = (not edge for edge in self.open_edges())
        h, w = self.image.shape[:2]
        width = float(x1 - x0)
        missing = 0.5 * width if self.span is None else max(self.span * (1.0 + self.span_sigma) - width, 0.0)
        across = np.array([(left and x0 <= 0) or (right and x1 >= w), (top and y0 <= 0) or (bottom and y1 >= h)])
        sigma = np.hypot(_CUT_ANYWHERE * width, _CUT_ACROSS * missing * across)
        return np.asarray(np.diag((sigma * self.scale) ** 2), np.float64)

    def half_wing_gone(self, box: Box[int]) -> bool:
        """Return whether half a span, measured from the wing tip in view, ends outside the image."""
        if self.span is None:
            return False
        left, _, right, _ = (not edge for edge in self.open_edges())
        x0, _, x1, _ = box
        w = self.image.shape[1]
        return (left and x0 <= 0 and x1 < 0.5 * self.span) or (right and x1 >= w and w - x0 < 0.5 * self.span)

    def border_distance(self, point: FloatArray) -> float:
        """Return the distance of a full-image pixel to the image border; negative outside."""
        w, h = self.image_size_px
        return float(min(point[0], point[1], w - 1 - point[0], h - 1 - point[1]))


def crop_working_image(
    image: ImageArray | Picture,
    roi: Box[int],
    hint: DetectionHint,
    size: tuple[float | None, float],
    limits: tuple[float, float],
) -> WorkingImage:
    """Crop the region of interest and reduce its resolution for large targets.

    ``size`` is the expected span in px and the sigma of its logarithm, ``limits`` the smallest span in px and
    the largest one without reduction.
    """
    span, sigma = size
    picture = as_picture(image)
    window, _ = picture.window(roi)
    scale = 1
    while span is not None and span / scale > limits[1]:
        scale *= 2
    if scale > 1:
        roi = box_of_size(roi.x0, roi.y0, max(roi.w - roi.w % scale, 1), max(roi.h - roi.h % scale, 1))
        reduced = (max(roi.w // scale, 1), max(roi.h // scale, 1))
        window = np.asarray(cv2.resize(window[: roi.h, : roi.w], reduced, interpolation=cv2.INTER_AREA), np.uint8)
    offset = np.array([roi.x0, roi.y0]) + 0.5 * (scale - 1)
    metres = span * scale / hint.px_per_m if span is not None and hint.px_per_m else None
    return WorkingImage(
        roi=roi,
        scale=scale,
        image=np.ascontiguousarray(window),
        image_size_px=picture.size_px,
        offset=offset,
        predicted=(np.asarray(hint.predicted_px, np.float64) - offset) / scale,
        covariance=np.asarray(hint.predicted_covariance_px2, np.float64) / scale**2,
        span=None if span is None else max(span / scale, limits[0]),
        span_sigma=max(sigma, _MIN_SPAN_SIGMA),
        forward=_in_spans(hint.forward_px_per_m, hint.px_per_m),
        up=_in_spans(hint.up_px_per_m, hint.px_per_m),
        height_per_span=None if hint.height_m is None or not metres else hint.height_m / metres,
    )


def _in_spans(shift_px_per_m: FloatArray | None, px_per_m: float | None) -> FloatArray | None:
    """Return an image shift per metre as a share of the scale, None where either is unknown."""
    if shift_px_per_m is None or not px_per_m:
        return None
    return np.asarray(shift_px_per_m, np.float64) / px_per_m


@njit(cache=True, nogil=True)
def _likely(first: int, last: int, low: float, high: float, sigma: float) -> NDArray[np.float32]:
    """Return the probability that the target covers each place in [first, last): 1 from ``low`` to ``high``."""
    likely = np.empty(max(last - first, 0), np.float32)
    for k in range(likely.size):
        beyond = max(low - (first + k), first + k - high, 0.0) / sigma
        likely[k] = math.exp(-0.5 * beyond * beyond)
    return likely


def expectation(working: WorkingImage) -> ExpectedTarget:
    """Return the box of the expected target in the working image, with the probability of each column and row."""
    h, w = working.image.shape[:2]
    span = working.span if working.span is not None else UNKNOWN_SPAN_PX
    first, last, likely = [0, 0], [0, 0], []
    for axis, (size, half) in enumerate(((w, 0.7), (h, 0.35))):
        # the tail trails behind the nose
        tail = 0.0 if working.forward is None else -_LENGTH_PER_SPAN * span * float(working.forward[axis])
        middle, sigma = float(working.predicted[axis]), math.sqrt(float(working.covariance[axis, axis])) + 1.0
        low, high = middle + min(tail, 0.0) - half * span, middle + max(tail, 0.0) + half * span
        first[axis] = int(min(max(low - 2.0 * sigma, 0.0), size))
        last[axis] = int(min(max(high + 2.0 * sigma + 1.0, 0.0), size))
        likely.append(_likely(first[axis], last[axis], low, high, sigma))
    box = Box(first[0], first[1], last[0], last[1])
    # end-on the silhouette is a body and a thin wing; from other or unknown directions it may be thicker
    length = (
        1.0 if working.forward is None else min(math.hypot(float(working.forward[0]), float(working.forward[1])), 1.0)
    )
    thick = None if working.span is None else (_THICK_END_ON + _THICK_PER_LENGTH * length) * working.span
    return ExpectedTarget(box=box, columns=likely[0], rows=likely[1], span_px=working.span, thick_px=thick)
