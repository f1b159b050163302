"""Appearance model of the target, learnt from confident frames, to distinguish it from birds and other objects."""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box

# mean grey, blue-red, green-magenta in grey levels; ln(height / width); ln(area / width²)
_TOLERANCE = np.array([14.0, 6.0, 6.0, 0.25, 0.3])
_SMALL_PX = 12.0  # below this width a pixel more or less changes the shape
_ENOUGH_FRAMES = 5
_AGEING_PER_MISS = 0.15


@njit(cache=True, nogil=True)
def features(colour: FloatArray, width: float, height: float, area: float) -> FloatArray:
    """Return the (5,) features of one silhouette: its mean grey, blue-red and green-magenta (3,), and its shape."""
    seen = np.empty(5)
    seen[:3] = colour
    seen[3] = math.log(max(height, 1.0) / max(width, 1.0))
    seen[4] = math.log(max(area, 1.0) / max(width, 1.0) ** 2)
    return seen


@njit(cache=True, nogil=True)
def features_of_regions(
    image: ImageArray,
    labels: NDArray[np.int32],
    members: NDArray[np.int64],
    box: Box[int],
    area: float,
) -> FloatArray:
    """Return the (5,) features of some regions of an image (h, w, 3).

    ``labels`` (h, w) mark the ``members`` (n,), ``box`` contains them, and ``area`` is their number of
    px.
    """
    # one place more than the largest member's, for all labels beyond
    other = members.max() + 1
    belongs = np.zeros(other + 1, np.bool_)
    for k in members:
        belongs[k] = True
    blue, green, red, n = np.int64(0), np.int64(0), np.int64(0), 0
    for i in range(box.y0, box.y1):
        line, row = labels[i, box.x0 : box.x1], image[i, box.x0 : box.x1]
        for j in range(line.size):
            if belongs[min(line[j], other)]:
                blue += np.int64(row[j, 0])
                green += np.int64(row[j, 1])
                red += np.int64(row[j, 2])
                n += 1
    total = np.empty(3)
    total[0] = 0.114 * blue + 0.587 * green + 0.299 * red
    total[1] = 0.5 * (blue - red)
    total[2] = 0.5 * green - 0.25 * (blue + red)
    return features(total / max(n, 1), float(box.x1 - box.x0), float(box.y1 - box.y0), area)


@njit(cache=True, nogil=True)
def _distance(seen: FloatArray, mean: FloatArray, variance: FloatArray, slack: float) -> float:
    """Return the root mean square of the features' deviations in sigmas."""
    total = 0.0
    for k in range(seen.size):
        total += (seen[k] - mean[k]) ** 2 / ((slack * _TOLERANCE[k]) ** 2 + variance[k])
    return math.sqrt(total / seen.size)


@njit(cache=True, nogil=True)
def _learnt(mean: FloatArray, variance: FloatArray, seen: FloatArray, gain: float) -> tuple[FloatArray, FloatArray]:
    """Return running mean and variance after one more sample."""
    new_mean, new_variance = np.empty_like(mean), np.empty_like(variance)
    for k in range(seen.size):
        error = seen[k] - mean[k]
        new_mean[k] = mean[k] + gain * error
        new_variance[k] = (1.0 - gain) * (variance[k] + gain * error**2)
    return new_mean, new_variance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Appearance:
    """Running mean and variance of the features, and how many frames they come from."""

    mean: FloatArray
    variance: FloatArray
    frames: int

    def distance(self, seen: FloatArray, width: float, misses: int) -> float:
        """Return how unlike the target a silhouette is, in sigmas; 0 until enough has been learnt."""
        if self.frames < _ENOUGH_FRAMES:
            return 0.0
        slack = 1.0 + _SMALL_PX / max(width, 1.0) * 0.5 + _AGEING_PER_MISS * misses
        return float(_distance(seen, self.mean, self.variance, slack))

    def learn(self, seen: FloatArray, rate: float) -> "Appearance":
        """Return the appearance after one more confident frame."""
        mean, variance = _learnt(self.mean, self.variance, seen, max(rate, 1.0 / (self.frames + 1)))
        return Appearance(mean=mean, variance=variance, frames=self.frames + 1)


def initial_appearance(seen: FloatArray) -> Appearance:
    """Start from one frame."""
    return Appearance(mean=seen, variance=np.zeros_like(seen), frames=1)
