"""Sharpness of a clip: one sigma of the joint blur of lens, motion and coder."""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box, clip, expand

# of the clips of *train* that show enough edges, the median (benchmarks/composites.py --measures)
USUAL_BLUR_PX = 0.47
_LEAST_SLOPE, _LEAST_EDGES = 12.0, 60
_MOST_PIXELS = 30_000
# the two sides of an edge are looked at up to so far from it, px
_SIDE_PX = 4
# what central differences over two pixels, and a pixel's own width, add to the variance of an edge, px²
_WIDTHS_PX2 = 4.0 / 12.0 + 1.0 / 12.0
# an aircraft's outline is sharp; of the scene's edges only the sharpest share is
_OF_AIRCRAFT, _OF_SCENE = 0.5, 0.2
# a picture is never sharper than its pixels
_LEAST_PX, _MOST_PX = 0.4, 2.5


def edge_blur_px(frames: Sequence[ImageArray], boxes: Sequence[Box[float] | None]) -> float:
    """Return one sigma, px, of the blur of frames (h, w, 3) of one clip; `USUAL_BLUR_PX` where they show no edges.

    The edges are those of the real aircraft in its ``boxes``, or of the whole scene where these are too few. A step of
    height A that is blurred by a Gaussian of sigma s has a slope of A / (s √(2π)) in its middle.
    """
    found = _edges([part for frame, box in zip(frames, boxes, strict=True) for part in _cut(frame, box)])
    share = _OF_AIRCRAFT
    if len(found) < _LEAST_EDGES:
        found, share = _edges(frames[:: max(len(frames) // 5, 1)]), _OF_SCENE
    if len(found) < _LEAST_EDGES:
        return USUAL_BLUR_PX
    own_px2 = max(float(np.quantile(found, share)) ** 2 - _WIDTHS_PX2, 0.0)
    return float(np.clip(math.sqrt(own_px2), _LEAST_PX, _MOST_PX))


def _cut(frame: ImageArray, box: Box[float] | None) -> list[ImageArray]:
    """Return the part of a frame in a box, with room for the sides of its edges; nothing without a box."""
    if box is None:
        return []
    whole = Box(math.floor(box.x0), math.floor(box.y0), math.ceil(box.x1), math.ceil(box.y1))
    inside = clip(expand(whole, _SIDE_PX + 1), (frame.shape[1], frame.shape[0]))
    return [] if inside is None or min(inside.size) <= 2 * (_SIDE_PX + 1) else [frame[inside.slices]]


def _edges(pictures: Sequence[ImageArray]) -> FloatArray:
    """Return the sigmas (n,) of the edges in all pictures."""
    greys = (np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.float64) for picture in pictures)
    return np.concatenate([np.zeros(0), *(_edge_sigmas(grey) for grey in greys)])


def _edge_sigmas(grey: FloatArray) -> FloatArray:
    """Return the sigma (n,), differences' widths included, of each pixel where the slope is steep and greatest."""
    by_row, by_column = np.gradient(grey, axis=0), np.gradient(grey, axis=1)
    slope = np.hypot(by_column, by_row)
    margin = _SIDE_PX + 1
    inner = np.zeros(slope.shape, dtype=bool)
    inner[margin:-margin, margin:-margin] = True
    rows, columns = np.nonzero(inner & (slope > _LEAST_SLOPE))
    # evenly fewer where OpenCV would refuse so many
    step = rows.size // _MOST_PIXELS + 1
    rows, columns = rows[::step], columns[::step]
    along = np.stack([by_column[rows, columns], by_row[rows, columns]]) / slope[rows, columns]

    def at(picture: FloatArray, far_px: float) -> FloatArray:
        u, v = columns + far_px * along[0], rows + far_px * along[1]
        return np.asarray(
            cv2.remap(
                picture.astype(np.float32), u.astype(np.float32)[None], v.astype(np.float32)[None], cv2.INTER_LINEAR
            )[0],
            np.float64,
        )

    if rows.size == 0:
        return np.zeros(0)
    steepest = slope[rows, columns] >= np.maximum(at(slope, 1.0), at(slope, -1.0))
    # a line ends before the farthest pixel that is looked at
    steps = range(1, _SIDE_PX + 1)
    height = np.max([at(grey, k) for k in steps], axis=0) - np.min([at(grey, -k) for k in steps], axis=0)
    sigma = height / (slope[rows, columns] * math.sqrt(2.0 * math.pi))
    return np.asarray(sigma[steepest & (height > 2.0 * _LEAST_SLOPE)])
