"""From pixels to one scalar image: background flattened, contrast in sigmas, scaled to [0, 1].

The background is a large median of each colour: it follows shaded skies, hills and straight edges such as the
horizon, and leaves what is smaller than its window. What remains is judged by the local background's own
spread, so that paint and trees count as noise where there are many of them. The reference system's choice,
the equalised saturation, stays available.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray, MaskArray
from groundstation.detection.background import Difference
from groundstation.detection.config import Channel, DetectionConfig
from groundstation.detection.palette import discount_common_colours
from groundstation.messages import Roi

Float32Array = NDArray[np.float32]

_MIN_WINDOW_PX = 15
_WINDOW_PER_SPAN = 0.6
_UNKNOWN_SPAN_PX = 80.0
_NOISE_FLOOR = 0.6  # grey levels: quantisation and what a codec smooths away
_CLUTTER_CLIP = 60.0
_COLOUR_CLIP = 8.0
_LEARNT_CLIP = 12.0
_REFERENCE = 4.0
_TAIL = 2.0  # sigmas that noise alone reaches at the shares in question


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expectation:
    """Where the target is expected in the window.

    ``box`` x0, y0, x1, y1 holds it, ``columns`` (x1 − x0,) and ``rows`` (y1 − y0,) float32 say how likely it
    reaches there, 1 in the middle; ``span_px`` is its expected span, None if not known.
    """

    box: tuple[int, int, int, int]
    columns: Float32Array
    rows: Float32Array
    span_px: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """The scalar image that the level set divides.

    ``u`` is (h, w) float32 in [0, 1], ``contrast`` (h, w) float32 the distance from the local background in
    its sigmas, ``level`` what the target's own number of pixels exceed near the prediction, ``reference`` the
    contrast that became u = 1. ``residual`` (h, w, 3) float32 is grey, blue-red
    and green-magenta against the background, in grey levels.
    """

    u: Float32Array
    contrast: Float32Array
    residual: Float32Array
    level: float
    reference: float
    channel: Channel


@njit(cache=True)
def _opponent_residual(image: ImageArray, background: ImageArray, out: Float32Array) -> None:
    """Write grey, blue minus red, green minus magenta of ``image − background``."""
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            b = float(image[i, j, 0]) - float(background[i, j, 0])
            g = float(image[i, j, 1]) - float(background[i, j, 1])
            r = float(image[i, j, 2]) - float(background[i, j, 2])
            out[i, j, 0] = 0.114 * b + 0.587 * g + 0.299 * r
            out[i, j, 1] = 0.5 * (b - r)
            out[i, j, 2] = 0.5 * g - 0.25 * (b + r)


@njit(cache=True)
def _clutter_moments(residual: Float32Array, keep_out: tuple[int, int, int, int], clip: float) -> FloatArray:
    """Return the (3, 3) second moments of the residual outside the box x0, y0, x1, y1, clipped to ±``clip``.

    Every second pixel of every second row is enough.
    """
    x0, y0, x1, y1 = keep_out
    moments = np.zeros((3, 3))
    n = 0
    e = np.zeros(3)
    for i in range(0, residual.shape[0], 2):
        for j in range(0, residual.shape[1], 2):
            if y0 <= i < y1 and x0 <= j < x1:
                continue
            for c in range(3):
                e[c] = min(max(residual[i, j, c], -clip), clip)
            n += 1
            for c in range(3):
                for d in range(c, 3):
                    moments[c, d] += e[c] * e[d]
    for c in range(3):
        for d in range(c, 3):
            moments[c, d] /= max(n, 1)
            moments[d, c] = moments[c, d]
    return moments


@njit(cache=True)
def _distance(residual: Float32Array, inverse: FloatArray, out: Float32Array) -> None:
    """Write the Mahalanobis length of each residual, less what noise alone would give."""
    a, b, c = inverse[0, 0], inverse[1, 1], inverse[2, 2]
    ab, ac, bc = 2 * inverse[0, 1], 2 * inverse[0, 2], 2 * inverse[1, 2]
    for i in range(residual.shape[0]):
        for j in range(residual.shape[1]):
            x, y, z = residual[i, j, 0], residual[i, j, 1], residual[i, j, 2]
            square = a * x * x + b * y * y + c * z * z + ab * x * y + ac * x * z + bc * y * z
            out[i, j] = math.sqrt(max(square, 0.0))


@njit(cache=True)
def _scale(contrast: Float32Array, reference: float, out: Float32Array) -> None:
    for i in range(contrast.shape[0]):
        for j in range(contrast.shape[1]):
            out[i, j] = min(contrast[i, j] / reference, 1.0)


def median_window(span_px: float | None) -> int:
    """Return the odd width of the background median for a target of this span."""
    span = _UNKNOWN_SPAN_PX if span_px is None else span_px
    return max(_MIN_WINDOW_PX, min(int(_WINDOW_PER_SPAN * span), 151)) | 1


def background_median(image: ImageArray, window: int) -> ImageArray:
    """Return the median of each channel; wide windows are taken on a reduced image."""
    return cast(ImageArray, cv2.medianBlur(image, window))


def prepare(
    image: ImageArray, expected: Expectation, difference: Difference | None, config: DetectionConfig
) -> Prepared:
    """Flatten the background, choose the channel and scale it.

    Parameters
    ----------
    image : (h, w, 3) uint8 BGR, the region of interest.
    expected : where in it the target is expected.
    difference : the image less the background learnt from earlier frames, None if there is none.
    """
    span_px, target_box = expected.span_px, expected.box
    residual = np.empty(image.shape, np.float32)
    window = median_window(span_px)
    _opponent_residual(image, background_median(image, window), residual)
    moments = _clutter_moments(residual, target_box, _CLUTTER_CLIP)
    area = 0.03 * (span_px if span_px is not None else 25.0) ** 2
    options: list[tuple[Channel, Float32Array, float, float]] = []
    wanted = config.channel
    if wanted in (Channel.AUTO, Channel.GREY):
        sigma = math.sqrt(moments[0, 0] + _NOISE_FLOOR**2)
        grey = cast(Float32Array, np.abs(residual[:, :, 0]) / np.float32(sigma))
        options.append((Channel.GREY, grey, *_levels(grey, expected, area)))
    if wanted in (Channel.AUTO, Channel.COLOUR, Channel.BACKGROUND):
        colour = np.empty(image.shape[:2], np.float32)
        spread = _clutter_moments(residual, target_box, _COLOUR_CLIP) + _NOISE_FLOOR**2 * np.eye(3)
        _distance(residual, np.asarray(np.linalg.inv(spread), np.float64), colour)
        discount_common_colours(residual, np.sqrt(np.diag(spread)), target_box, colour)
        options.append((Channel.COLOUR, colour, *_levels(colour, expected, area)))
        if difference is not None:
            learnt = _learnt_contrast(difference, colour, target_box)
            options.append((Channel.BACKGROUND, learnt, *_levels(learnt, expected, area)))
    if wanted is Channel.SATURATION:
        saturation = saturation_contrast(image, window, target_box, equalise=config.equalise)
        options.append((Channel.SATURATION, saturation, *_levels(saturation, expected, area)))
    channel, contrast, level, far = max(options, key=lambda o: o[2] / o[3])
    # a strong target need not be cut at half its height: nearer the noise, its pale parts stay with it
    reference = max(min(level, _REFERENCE * math.sqrt(level * far)), config.min_contrast_to_noise)
    u = np.empty_like(contrast)
    _scale(contrast, reference, u)
    return Prepared(u=u, contrast=contrast, residual=residual, reference=reference, level=level, channel=channel)


def _learnt_contrast(
    difference: Difference, spatial: Float32Array, target_box: tuple[int, int, int, int]
) -> Float32Array:
    """Return the distance from the learnt background in its sigmas, the spatial contrast where it is not known."""
    contrast = np.empty_like(spatial)
    settled = np.where(difference.known[:, :, None], difference.residual, np.float32(0))
    moments = _clutter_moments(settled, target_box, _LEARNT_CLIP) + _NOISE_FLOOR**2 * np.eye(3)
    inverse = np.asarray(np.linalg.inv(moments), np.float64)
    _distance(difference.residual, inverse, contrast)
    contrast /= np.sqrt(1.0 + difference.edge**2 / np.float32(moments[0, 0]))
    np.copyto(contrast, spatial, where=~difference.known)
    return contrast


def _levels(contrast: Float32Array, expected: Expectation, area_px: float) -> tuple[float, float]:
    """Return the level that ``area_px`` pixels exceed near the prediction, and what their share exceeds elsewhere."""
    x0, y0, x1, y1 = expected.box
    near = contrast[y0:y1, x0:x1] * expected.columns * expected.rows[:, None]
    share = min(max(area_px, 3.0) / near.size, 0.3)
    level = _quantile(near.ravel(), share)
    far = [contrast[:y0:2, ::2], contrast[y1::2, ::2], contrast[y0:y1:2, :x0:2], contrast[y0:y1:2, x1::2]]
    rest = np.concatenate([part.ravel() for part in far])
    return level, max(_quantile(rest, share), _TAIL) if rest.size > 50 else _TAIL


def _quantile(values: Float32Array, share: float) -> float:
    """Return the value that this share of ``values`` exceeds."""
    k = max(values.size - 1 - int(share * values.size), 0)
    return float(np.partition(values, k)[k])


def saturation_contrast(
    image: ImageArray, window: int, target_box: tuple[int, int, int, int], *, equalise: bool
) -> Float32Array:
    """Return the saturation's distance from its flattened background in sigmas, (h, w)."""
    saturation = cast(ImageArray, cv2.cvtColor(image, cv2.COLOR_BGR2HSV)[:, :, 1])
    if equalise:
        saturation = cast(ImageArray, cv2.equalizeHist(saturation))
    residual = saturation.astype(np.float32) - cv2.medianBlur(saturation, window)
    outside = np.ones(residual.shape, np.bool_)
    outside[target_box[1] : target_box[3], target_box[0] : target_box[2]] = False
    spread = float(np.sqrt(np.mean(residual[outside] ** 2))) if outside.any() else float(residual.std())
    return np.abs(residual) / np.float32(math.hypot(spread, _NOISE_FLOOR))


def measure_channels(image: ImageArray, roi: Roi, mask: MaskArray) -> Mapping[str, float]:
    """Return each channel's contrast-to-noise of a silhouette against its surroundings in the ROI.

    ``mask`` is (roi.h, roi.w), True on the target. The contrast is the difference of the means inside and
    in the ROI outside (after flattening), the noise the standard deviation outside. "saturation" is the
    reference system's channel.
    """
    window_image = image[roi.y : roi.y + roi.h, roi.x : roi.x + roi.w]
    columns = np.flatnonzero(mask.any(axis=0))
    span = float(columns[-1] - columns[0] + 1) if columns.size else None
    window = median_window(span)
    near = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    residual = np.empty(window_image.shape, np.float32)
    _opponent_residual(window_image, background_median(window_image, window), residual)
    saturation = cast(ImageArray, cv2.cvtColor(window_image, cv2.COLOR_BGR2HSV)[:, :, 1])
    flat = {
        Channel.GREY.value: residual[:, :, 0],
        Channel.SATURATION.value: saturation.astype(np.float32) - cv2.medianBlur(saturation, window),
    }
    result: dict[str, float] = {}
    if not mask.any() or near.all():
        return result
    for name, values in flat.items():
        noise = max(float(values[~near].std()), 1e-3)
        result[name] = abs(float(values[mask].mean() - values[~near].mean())) / noise
    outside = residual[~near].astype(np.float64)
    difference = residual[mask].mean(axis=0) - outside.mean(axis=0)
    inverse = np.linalg.inv(np.cov(outside.T) + 1e-3 * np.eye(3))
    result[Channel.COLOUR.value] = float(math.sqrt(max(difference @ inverse @ difference, 0.0)))
    return result
