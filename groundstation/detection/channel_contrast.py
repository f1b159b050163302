"""Contrast of a silhouette in each channel, for the report and the comparison of channels."""

import math
from collections.abc import Mapping
from typing import cast

import cv2
import numpy as np
from numba import njit

from groundstation.arrays import FloatArray, ImageArray, MaskArray
from groundstation.box import Box
from groundstation.detection.config import Channel
from groundstation.detection.flatten import flatten
from groundstation.detection.level_set_input import WINDOW_PER_SPAN, Float32Array, median_window
from groundstation.picture import Picture, as_picture


def measure_channels(image: ImageArray | Picture, roi: Box[int], mask: MaskArray) -> Mapping[str, float]:
    """Return each channel's contrast-to-noise of a silhouette against its surroundings in the ROI.

    ``mask`` is (roi.h, roi.w), True on the target. The contrast is the difference of the means inside and
    in the ROI outside (after flattening), the noise the standard deviation outside. "saturation" is the
    reference system's channel.
    """
    window_image, _ = as_picture(image).window(roi)
    columns = np.flatnonzero(mask.any(axis=0))
    span = float(columns[-1] - columns[0] + 1) if columns.size else None
    window = median_window(None if span is None else WINDOW_PER_SPAN * span)
    near = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    if not mask.any() or near.all():
        return {}
    saturation = cast(ImageArray, cv2.cvtColor(window_image, cv2.COLOR_BGR2HSV)[:, :, 1])
    flat = saturation.astype(np.float32) - cv2.medianBlur(saturation, window)
    difference, spread = _inside_less_outside(flatten(window_image, window), flat, mask, near)
    grey, saturated = (abs(float(difference[k])) / max(math.sqrt(spread[k, k]), 1e-3) for k in (0, 3))
    n = int(near.size - np.count_nonzero(near))
    inverse = np.linalg.inv(spread[:3, :3] * n / max(n - 1, 1) + 1e-3 * np.eye(3))
    colour = math.sqrt(max(float(difference[:3] @ inverse @ difference[:3]), 0.0))
    return {Channel.GREY.value: grey, Channel.SATURATION.value: saturated, Channel.COLOUR.value: colour}


@njit(cache=True, nogil=True)
def _inside_less_outside(
    residual: Float32Array, saturation: Float32Array, mask: MaskArray, near: MaskArray
) -> tuple[FloatArray, FloatArray]:
    """Return the means (4,) on the mask less those away from it, and the covariance (4, 4) away from it.

    Of the three planes of the residual (3, h, w) and the saturation (h, w); ``near`` is the mask and its rim.
    """
    sums, counts = np.zeros((2, 4)), np.zeros(2)
    value = np.empty(4)
    spread = np.zeros((4, 4))
    # the means first: squares of values far from zero would lose digits
    for turn in range(2):
        for i in range(mask.shape[0]):
            for j in range(mask.shape[1]):
                inside, outside = mask[i, j], not near[i, j]
                if not (inside or outside):
                    continue
                part = 0 if inside else 1
                for c in range(3):
                    value[c] = residual[c, i, j]
                value[3] = saturation[i, j]
                if turn == 0:
                    counts[part] += 1
                    for c in range(4):
                        sums[part, c] += value[c]
                elif outside:
                    for c in range(4):
                        away = value[c] - sums[1, c]
                        for d in range(c + 1):
                            spread[c, d] += away * (value[d] - sums[1, d])
        if turn == 0:
            for part in range(2):
                sums[part] /= counts[part]
    for c in range(4):
        for d in range(c + 1):
            spread[c, d] /= counts[1]
            spread[d, c] = spread[c, d]
    return sums[0] - sums[1], spread
