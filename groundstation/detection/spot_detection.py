"""Spot detection: regions of an image by their contrast to the surroundings, the input of `candidate_finder`.

The image is processed at several scales. At each scale a coarse median is subtracted as the background, which removes
shaded skies and large clouds, and the residual is divided by the spread around it: a speck in an even sky gets a
higher contrast than a stronger one among tree crowns.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box, union
from groundstation.detection.bilinear import places_between, widened
from groundstation.detection.connected_components import connected_runs

Float32Array = NDArray[np.float32]

_GRID = 4  # the background's raster, px of the scale
_MEDIAN = 9  # its median window, in steps of the raster
_SPREAD_BLOCK = 16  # px of the scale over which the spread is measured, and the median window over such blocks
_SPREAD_MEDIAN = 5
_MAX_SPOTS = 60
_SPECK = 3.0  # px of the map: smaller regions are mostly noise
_NOISE_FLOOR = 0.7  # grey levels
_SPREAD_TO_SIGMA = 1.4


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateRegion:
    """A region that stands out: ``box`` and ``centre`` in px of the full image.

    The box counts from the edge of pixel 0.

    ``contrast`` is its root mean square, in sigmas of the surroundings, less for specks of a pixel or two;
    ``mass`` the sum. ``sky`` is the share of sky around it.
    """

    box: Box[float]
    centre: tuple[float, float]
    contrast: float
    mass: float
    sky: float = 0.0

    @property
    def size(self) -> float:
        """The longer side of the box, px."""
        return self.box.length


def scales(grey: ImageArray, count: int, reduction: int) -> list[ImageArray]:
    """Return ``count`` reduced copies, each ``reduction`` times smaller than the one before; the first as it is."""
    pyramid = [grey]
    while len(pyramid) < count:
        h, w = pyramid[-1].shape
        if min(h, w) < 8 * reduction * _GRID:
            break
        size = (w // reduction, h // reduction)
        pyramid.append(np.asarray(cv2.resize(pyramid[-1], size, interpolation=cv2.INTER_AREA), np.uint8))
    return pyramid


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contrast:
    """``sigmas`` (h, w) float32: each pixel's signed contrast in sigmas of its surroundings.

    ``spread`` is the mean deviation from the background in coarse blocks, grey levels.
    """

    sigmas: Float32Array
    spread: Float32Array


def contrast_map(grey: ImageArray) -> Contrast:
    """Return how a picture differs from its coarse background."""
    h, w = grey.shape
    small = cv2.resize(grey, (max(w // _GRID, 1), max(h // _GRID, 1)), interpolation=cv2.INTER_AREA)
    # a shaded sky is extrapolated beyond the border with its gradient
    pad = _MEDIAN // 2 + 1
    wide = np.pad(small.astype(np.int16), pad, mode="reflect", reflect_type="odd")
    coarse = cv2.medianBlur(np.clip(wide, 0, 255).astype(np.uint8), _MEDIAN).astype(np.float32)
    smooth = cv2.blur(coarse, (3, 3))[pad:-pad, pad:-pad]
    residual, deviation = _residual(grey, np.ascontiguousarray(smooth, np.float32))
    spread = cv2.blur(cv2.medianBlur(deviation, _SPREAD_MEDIAN), (3, 3))
    sigma = np.maximum(_SPREAD_TO_SIGMA * spread, _NOISE_FLOOR)
    _divide(residual, np.asarray(sigma, np.float32))
    return Contrast(sigmas=residual, spread=np.asarray(spread, np.float32))


@njit(cache=True, nogil=True, fastmath=True)
def _residual(grey: ImageArray, coarse: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return a picture (h, w) less its coarse background (rows, columns), and the mean deviation from it in blocks."""
    (h, w), rows = grey.shape, coarse.shape[0]
    out = np.empty((h, w), np.float32)
    blocks = np.zeros((max(h // _SPREAD_BLOCK, 1), max(w // _SPREAD_BLOCK, 1)), np.float32)
    wide, (above, below, share) = widened(coarse, w), places_between(h, rows, rows / h)
    for a in range(blocks.shape[0]):
        total = np.zeros(w, np.float32)
        top, end = a * h // blocks.shape[0], (a + 1) * h // blocks.shape[0]
        for i in range(top, end):
            new, upper, lower, to = grey[i], wide[above[i]], wide[below[i]], out[i]
            down, up = share[i], np.float32(1) - share[i]
            for j in range(w):
                d = np.float32(new[j]) - (up * upper[j] + down * lower[j])
                to[j] = d
                total[j] += abs(d)
        for b in range(blocks.shape[1]):
            left, right = b * w // blocks.shape[1], (b + 1) * w // blocks.shape[1]
            blocks[a, b] = total[left:right].sum() / ((end - top) * (right - left))
    return out, blocks


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _divide(residual: Float32Array, sigma: Float32Array) -> None:
    """Divide a residual (h, w) in place by a coarse sigma (rows, columns), taken between its blocks' middles."""
    (h, w), rows = residual.shape, sigma.shape[0]
    wide, (above, below, share) = widened(sigma, w), places_between(h, rows, rows / h)
    for i in range(h):
        upper, lower, to = wide[above[i]], wide[below[i]], residual[i]
        down, up = share[i], np.float32(1) - share[i]
        for j in range(w):
            to[j] /= up * upper[j] + down * lower[j]


@njit(cache=True, nogil=True)
def _regions_beyond(contrast: Float32Array, limit: float) -> FloatArray:
    """Return the 8-connected regions beyond ±limit, each as x0, y0, x1, y1, area, Σ|c|, Σ|c|x, Σ|c|y, Σc², peak."""
    runs, number, count = connected_runs(np.abs(contrast) > limit)
    table = np.zeros((count - 1, 10))
    table[:, 0], table[:, 1] = contrast.shape[1], contrast.shape[0]
    for k in range(runs.shape[0]):
        i, first, end = runs[k]
        row = table[number[k] - 1]
        for j in range(first, end):
            c = abs(contrast[i, j])
            row[5] += c
            row[6] += c * j
            row[7] += c * i
            row[8] += c * c
            row[9] = max(row[9], c)
        row[0], row[1] = min(row[0], first), min(row[1], i)
        row[2], row[3] = max(row[2], end), i + 1
        row[4] += end - first
    return table


def find_spots(contrast: Float32Array, low: float, high: float, scale: float) -> list[CandidateRegion]:
    """Return the connected regions beyond ±``low`` that somewhere pass ±``high``, strongest first.

    ``scale`` is the size of one pixel of the map in px of the full image.
    """
    table = _regions_beyond(contrast, low)
    table = table[table[:, 9] >= high]
    strength = np.sqrt(table[:, 8] / np.maximum(table[:, 4], _SPECK))
    order = np.argsort(-strength, kind="stable")[:_MAX_SPOTS]
    shift = 0.5 * (scale - 1.0)
    return [
        CandidateRegion(
            box=Box(row[0] * scale, row[1] * scale, row[2] * scale, row[3] * scale),
            centre=(row[6] / row[5] * scale + shift, row[7] / row[5] * scale + shift),
            contrast=strong,
            mass=row[5] * scale * scale,
        )
        for row, strong in zip(table[order].tolist(), strength[order].tolist(), strict=True)
    ]


def gap(a: CandidateRegion, b: CandidateRegion) -> float:
    """Return the distance between two boxes, px; 0 where they touch."""
    dx = max(a.box.x0 - b.box.x1, b.box.x0 - a.box.x1, 0.0)
    dy = max(a.box.y0 - b.box.y1, b.box.y0 - a.box.y1, 0.0)
    return max(dx, dy)


def joined(spots: list[CandidateRegion], reach: float, least_px: float, growth: float) -> list[CandidateRegion]:
    """Merge the fragments of one object, strongest first.

    A fragment joins a piece of more mass if it lies closer than ``reach`` of that piece's size (or ``least_px``)
    and does not make it larger than ``growth`` times its size (or three times ``least_px``).
    """
    whole: list[tuple[CandidateRegion, CandidateRegion]] = []  # each with its main piece
    for s in sorted(spots, key=lambda s: -s.mass):
        for i, (w, main) in enumerate(whole):
            union = _union(w, s)
            near = gap(w, s) <= max(reach * main.size, least_px)
            if near and union.size <= max(growth * main.size, 3.0 * least_px):
                whole[i] = (union, main)
                break
        else:
            whole.append((s, s))
    return sorted((w for w, _ in whole), key=lambda s: -s.contrast)


def _union(a: CandidateRegion, b: CandidateRegion) -> CandidateRegion:
    share = a.mass / (a.mass + b.mass)
    return CandidateRegion(
        box=union(a.box, b.box),
        centre=(
            share * a.centre[0] + (1 - share) * b.centre[0],
            share * a.centre[1] + (1 - share) * b.centre[1],
        ),
        contrast=max(a.contrast, b.contrast),
        mass=a.mass + b.mass,
        sky=min(a.sky, b.sky),
    )
