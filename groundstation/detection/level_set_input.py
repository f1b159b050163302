"""From pixels to one scalar image: background flattened, contrast in sigmas, scaled to [0, 1].

The background is a large median of each colour: it follows shaded skies, hills and straight edges such as the
horizon, and leaves structures smaller than its window. The difference is divided by the local background's own
spread, so that paint and trees count as noise where there are many of them. The reference system's channel,
the equalised saturation, is available as an option.
"""

import math
from dataclasses import dataclass, replace
from typing import cast

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box
from groundstation.detection.background import Difference
from groundstation.detection.background_histogram import suppress_background_colours
from groundstation.detection.config import Channel, DetectionConfig
from groundstation.detection.flatten import flatten

Float32Array = NDArray[np.float32]

_MIN_WINDOW_PX = 15
_MAX_WINDOW_PX = 151
WINDOW_PER_SPAN = 0.6  # of a target seen end-on
_UNKNOWN_SPAN_PX = 80.0
_NOISE_FLOOR = 0.6  # grey levels: quantisation and smoothing by a codec
_CLUTTER_CLIP = 60.0
_COLOUR_CLIP = 8.0
_LEARNT_CLIP = 12.0
_LEARNT_TRUST = 2.0
_REFERENCE = 4.0
_BINS_PER_ROOT, _MAX_ROOT = 64, 32  # the histogram of contrast, over its square root
_ENOUGH_PX = 50
_MANY_PX = 8000
_TAIL = 2.0  # sigmas that noise alone reaches at the shares in question


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedTarget:
    """Expected position of the target in the window.

    ``box`` contains it, ``columns`` (box.w,) and ``rows`` (box.h,) float32 are the likelihood that it
    extends there, 1 in the middle; ``span_px`` is its expected span and ``thick_px`` a width that its thick parts
    fill by less than half, None if unknown.
    """

    box: Box[int]
    columns: Float32Array
    rows: Float32Array
    span_px: float | None
    thick_px: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LevelSetInput:
    """The scalar image that the level set divides.

    ``u`` is (h, w) float32 in [0, 1], ``contrast`` (h, w) float32 the distance from the local background in
    its sigmas, ``level`` the contrast that the target's own number of pixels exceed near the prediction, ``reference``
    the contrast that became u = 1.
    """

    u: Float32Array
    contrast: Float32Array
    level: float
    reference: float
    channel: Channel

    def fainter(self, share: float) -> "LevelSetInput":
        """Return the same with u = 1 at a ``share`` of the reference."""
        reference = share * self.reference
        return replace(self, u=_scaled(self.contrast, reference), reference=reference)


@njit(cache=True, nogil=True, fastmath=True)
def _clutter_moments(
    residual: Float32Array, keep_out: Box[int], clip: float, known: NDArray[np.bool_] | None = None
) -> FloatArray:
    """Return the (3, 3) second moments of a residual (3, h, w) outside the box, clipped to ±``clip``.

    Every second pixel of every second row is enough; pixels that are not ``known`` count as zero.
    """
    x0, y0, x1, y1 = keep_out
    s00, s01, s02, s11, s12, s22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    n = 0
    for i in range(0, residual.shape[1], 2):
        for part in range(2):
            first = 0 if part == 0 else (x1 + 1) // 2 * 2
            last = residual.shape[2] if part == 1 else x0
            if not y0 <= i < y1:
                first, last = (0, residual.shape[2]) if part == 0 else (0, 0)
            for j in range(first, last, 2):
                n += 1
                if known is not None and not known[i, j]:
                    continue
                a = min(max(residual[0, i, j], -clip), clip)
                b = min(max(residual[1, i, j], -clip), clip)
                c = min(max(residual[2, i, j], -clip), clip)
                s00 += a * a
                s01 += a * b
                s02 += a * c
                s11 += b * b
                s12 += b * c
                s22 += c * c
    return np.array([[s00, s01, s02], [s01, s11, s12], [s02, s12, s22]]) / max(n, 1)


@njit(cache=True, nogil=True, fastmath=True)
def _clutter_variance(plane: Float32Array, keep_out: Box[int], clip: float) -> float:
    """Return the second moment of one plane (h, w) alone, as `_clutter_moments` does of three."""
    x0, y0, x1, y1 = keep_out
    limit = np.float32(clip)
    total, n = 0.0, 0
    for i in range(0, plane.shape[0], 2):
        row = plane[i]
        for part in range(2):
            first = 0 if part == 0 else (x1 + 1) // 2 * 2
            last = row.size if part == 1 else x0
            if not y0 <= i < y1:
                first, last = (0, row.size) if part == 0 else (0, 0)
            of_row = np.float32(0)
            for j in range(first, last, 2):
                value = min(max(row[j], -limit), limit)
                of_row += value * value
            total += float(of_row)
            n += max(last - first + 1, 0) // 2
    return total / max(n, 1)


@njit(cache=True, nogil=True)
def _with_noise(moments: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the inverse (3, 3) of moments with the noise that there always is, and their sigmas (3,)."""
    spread = moments + _NOISE_FLOOR**2 * np.eye(3)
    sigmas: FloatArray = np.sqrt(np.diag(spread))
    inverse: FloatArray = np.linalg.inv(spread).astype(np.float64)
    return inverse, sigmas


@njit(cache=True, nogil=True, fastmath=True)
def _distance(residual: Float32Array, inverse: FloatArray, out: Float32Array) -> None:
    """Write the Mahalanobis length of each residual (3, h, w)."""
    a, b, c = np.float32(inverse[0, 0]), np.float32(inverse[1, 1]), np.float32(inverse[2, 2])
    ab, ac = np.float32(2 * inverse[0, 1]), np.float32(2 * inverse[0, 2])
    bc = np.float32(2 * inverse[1, 2])
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            x, y, z = residual[0, i, j], residual[1, i, j], residual[2, i, j]
            square = x * (a * x + ab * y + ac * z) + y * (b * y + bc * z) + c * z * z
            out[i, j] = np.sqrt(abs(square))  # rounding may take it below zero


@njit(cache=True, nogil=True, fastmath=True)
def _magnitude(values: Float32Array, gain: float) -> Float32Array:
    """Return the absolute values (h, w) times a gain."""
    scale, out = np.float32(gain), np.empty_like(values)
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = scale * abs(values[i, j])
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _scale(contrast: Float32Array, reference: float, out: Float32Array) -> None:
    gain = np.float32(1.0 / reference)
    for i in range(contrast.shape[0]):
        for j in range(contrast.shape[1]):
            out[i, j] = min(contrast[i, j] * gain, np.float32(1))


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _soften(
    contrast: Float32Array, edge: Float32Array, variance: float, known: NDArray[np.bool_], spatial: Float32Array
) -> None:
    """Divide by what misplacement may cause; where the background is not known, take the spatial contrast."""
    gain = np.float32(1.0 / variance)
    for i in range(contrast.shape[0]):
        own, steep, certain, other = contrast[i], edge[i], known[i], spatial[i]
        for j in range(own.size):
            # a division that may fail keeps the compiler from working on many at a time, and so does a choice of loads
            softer, instead = own[j] / np.sqrt(np.float32(1) + gain * steep[j] * steep[j]), other[j]
            own[j] = softer if certain[j] else instead


@njit(cache=True, nogil=True)
def _grey_gain(plane: Float32Array, keep_out: Box[int]) -> float:
    """Return the sigmas of the pixels outside the box in one level of a plane (h, w)."""
    return 1.0 / math.hypot(math.sqrt(_clutter_variance(plane, keep_out, _CLUTTER_CLIP)), _NOISE_FLOOR)


@njit(cache=True, nogil=True)
def _scaled(contrast: Float32Array, reference: float) -> Float32Array:
    """Return a contrast (h, w) as a share of the reference, at most 1."""
    u = np.empty_like(contrast)
    _scale(contrast, reference, u)
    return u


@njit(cache=True, nogil=True)
def _upper(count: NDArray[np.int32], share: float) -> float:
    """Return the value that this share of a histogram over the roots exceeds."""
    left = share * count.sum()
    for k in range(count.size - 1, -1, -1):
        if count[k] == 0:
            continue
        if count[k] > left:
            root = (k + 1.0 - left / count[k]) / _BINS_PER_ROOT
            return root * root
        left -= count[k]
    return 0.0


@njit(cache=True, nogil=True, inline="always")
def _place(value: np.float32) -> np.uint32:
    """Return the place of a contrast in the histogram over its root."""
    root = np.float32(_BINS_PER_ROOT) * np.sqrt(value)
    return np.uint32(np.int32(min(root, np.float32(_BINS_PER_ROOT * _MAX_ROOT - 1))))


@njit(cache=True, nogil=True)
def _levels(
    contrast: Float32Array, box: Box[int], columns: Float32Array, rows: Float32Array, area_px: float, gain: float = 1.0
) -> tuple[float, float]:
    """Return the level that ``area_px`` pixels exceed near the prediction, and what their share exceeds elsewhere.

    The levels are of ``contrast`` (h, w), its sign aside, times a gain.
    """
    x0, y0, x1, y1 = box
    scale = np.float32(gain)
    last = _BINS_PER_ROOT * _MAX_ROOT - 1
    near, far = np.zeros(last + 1, np.int32), np.zeros(last + 1, np.int32)
    places = np.empty(contrast.shape[1], np.uint32)
    # a share of many pixels is known well enough from every second row of them
    for i in range(y0, y1, 1 if (x1 - x0) * (y1 - y0) < _MANY_PX else 2):
        row, likely = contrast[i], rows[i - y0]
        # all of a row's places first, which the compiler does many at a time
        for k in range(x1 - x0):
            places[k] = _place(scale * abs(row[x0 + k]) * columns[k] * likely)
        for k in range(x1 - x0):
            near[places[k]] += 1
    left, right = (x0 + 1) // 2, (x1 + 1) // 2  # of every second column, those inside
    for i in range(0, contrast.shape[0], 2):
        row, crosses_box = contrast[i], y0 <= i < y1
        for k in range((row.size + 1) // 2):
            places[k] = _place(scale * abs(row[2 * k]))
        for k in range(left if crosses_box else 0):
            far[places[k]] += 1
        for k in range(max(right, left) if crosses_box else 0, (row.size + 1) // 2):
            far[places[k]] += 1
    share = min(max(area_px, 3.0) / ((x1 - x0) * (y1 - y0)), 0.3)
    return _upper(near, share), max(_upper(far, share), _TAIL) if far.sum() > _ENOUGH_PX else _TAIL


@njit(cache=True, nogil=True)
def _grey_levels(
    residual: Float32Array, box: Box[int], columns: Float32Array, rows: Float32Array, area_px: float
) -> tuple[float, float, float]:
    """Return the grey residual's gain to sigmas, and its levels."""
    gain = _grey_gain(residual[0], box)
    level, far = _levels(residual[0], box, columns, rows, area_px, gain)
    return gain, level, far


@njit(cache=True, nogil=True)
def _colour_levels(
    residual: Float32Array, box: Box[int], columns: Float32Array, rows: Float32Array, area_px: float, out: Float32Array
) -> tuple[float, float]:
    """Write the contrast (h, w) of a residual (3, h, w), less where its colour is common, and return its levels."""
    inverse, sigmas = _with_noise(_clutter_moments(residual, box, _COLOUR_CLIP, None))
    _distance(residual, inverse, out)
    suppress_background_colours(residual, sigmas, box, out)
    return _levels(out, box, columns, rows, area_px)


@njit(cache=True, nogil=True)
def _learnt_levels(
    residual: Float32Array,
    edge: Float32Array,
    known: NDArray[np.bool_],
    spatial: Float32Array,
    box: Box[int],
    columns: Float32Array,
    rows: Float32Array,
    area_px: float,
    contrast: Float32Array,
) -> tuple[float, float]:
    """Write the distance from the background model in its sigmas, completed as in `_soften`; return its levels."""
    inverse, sigmas = _with_noise(_clutter_moments(residual, box, _LEARNT_CLIP, known))
    _distance(residual, inverse, contrast)
    _soften(contrast, edge, sigmas[0] ** 2, known, spatial)
    return _levels(contrast, box, columns, rows, area_px)


def median_window(size_px: float | None) -> int:
    """Return the odd width of the background median for a silhouette whose thick parts have this size."""
    size = WINDOW_PER_SPAN * _UNKNOWN_SPAN_PX if size_px is None else size_px
    return max(_MIN_WINDOW_PX, min(int(size), _MAX_WINDOW_PX)) | 1


def prepare(
    image: ImageArray, expected: ExpectedTarget, difference: Difference | None, config: DetectionConfig
) -> LevelSetInput:
    """Flatten the background, choose the channel and scale it.

    Parameters
    ----------
    image : (h, w, 3) uint8 BGR, the region of interest.
    expected : the expected position of the target in it.
    difference : the image less the background of earlier frames, None without one.
    """
    span_px, target_box = expected.span_px, expected.box
    window = median_window(expected.thick_px)
    area = 0.03 * (span_px if span_px is not None else 25.0) ** 2
    expectation = (target_box, expected.columns, expected.rows, area)
    # of each channel its contrast, its remaining gain, and its levels
    options: list[tuple[Channel, Float32Array, float, float, float]] = []
    wanted = config.channel
    if wanted is Channel.SATURATION:
        contrast = saturation_contrast(image, window, target_box, equalise=config.equalise)
        options.append((wanted, contrast, 1.0, *_levels(contrast, *expectation)))
    else:
        residual = flatten(image, window)
        if wanted in (Channel.AUTO, Channel.GREY):
            # whether it is chosen follows from its levels; its contrast is computed only then
            options.append((Channel.GREY, residual[0], *_grey_levels(residual, *expectation)))
        if wanted is not Channel.GREY:
            colour = np.empty(image.shape[:2], np.float32)
            options.append((Channel.COLOUR, colour, 1.0, *_colour_levels(residual, *expectation, colour)))
            if difference is not None:
                learnt = np.empty_like(colour)
                residual, edge, known = difference.residual, difference.edge, difference.known
                levels = _learnt_levels(residual, edge, known, colour, *expectation, learnt)
                options.append((Channel.BACKGROUND, learnt, 1.0, *levels))
    # the learnt background does not take for a target what stands still: of about equal contrasts, its own counts
    trust = {Channel.BACKGROUND: _LEARNT_TRUST}
    channel, contrast, gain, level, far = max(options, key=lambda o: trust.get(o[0], 1.0) * o[3] / o[4])
    if channel is Channel.GREY:
        contrast = _magnitude(contrast, gain)
    # a strong target need not be cut at half its height: nearer the noise, its pale parts stay with it
    reference = max(min(level, _REFERENCE * math.sqrt(level * far)), config.min_contrast_to_noise)
    return LevelSetInput(
        u=_scaled(contrast, reference), contrast=contrast, reference=reference, level=level, channel=channel
    )


def saturation_contrast(image: ImageArray, window: int, target_box: Box[int], *, equalise: bool) -> Float32Array:
    """Return the saturation's distance from its flattened background in sigmas, (h, w)."""
    saturation = cast(ImageArray, cv2.cvtColor(image, cv2.COLOR_BGR2HSV)[:, :, 1])
    if equalise:
        saturation = cast(ImageArray, cv2.equalizeHist(saturation))
    residual = saturation.astype(np.float32) - cv2.medianBlur(saturation, window)
    outside = np.ones(residual.shape, np.bool_)
    outside[target_box[1] : target_box[3], target_box[0] : target_box[2]] = False
    spread = float(np.sqrt(np.mean(residual[outside] ** 2))) if outside.any() else float(residual.std())
    return np.abs(residual) / np.float32(math.hypot(spread, _NOISE_FLOOR))
