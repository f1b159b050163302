"""Update with a missed detection: the predicted density inside the image loses weight.

The density inside the image is multiplied by 1 − P_D and replaced by the Gaussian with the moments of the result.
"""

import math
from collections.abc import Mapping

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.kalman_kernels import innovation_covariance
from groundstation.estimation.out_of_view_weight import probability_in_view
from groundstation.estimation.updates.measurements import MissedDetection
from groundstation.estimation.updates.pixel_model import PixelModel
from groundstation.estimation.updates.update import MomentMatching, PredictedState
from groundstation.geometry.station import StationGeometry

# no effect if the probability inside the image is this close to 0 or 1
_NEGLIGIBLE_PROBABILITY = 0.02
_SQRT2 = math.sqrt(2.0)


class MissUpdate:
    """Update with missed detections of the cameras."""

    def __init__(self, stations: Mapping[str, StationGeometry], pixels: Mapping[str, PixelModel]) -> None:
        self._stations, self._pixels = stations, pixels

    def __call__(self, state: PredictedState, miss: MissedDetection) -> MomentMatching | None:
        """Return the correction; None if the prediction is completely inside the image, or behind the camera."""
        prediction = self._pixels[miss.station].predict(state.x, 0.0, state.age_s)
        if prediction is None:
            return None
        S = innovation_covariance(state.P, prediction.jacobian, np.zeros((2, 2)))
        size = self._stations[miss.station].image_size_px
        inside = probability_in_view(prediction.pixel, S, size)
        if not _NEGLIGIBLE_PROBABILITY < inside < 1.0 - _NEGLIGIBLE_PROBABILITY:
            return None
        mean, covariance = moments_after_miss(prediction.pixel, S, size, miss.detection_probability)
        shift = mean - prediction.pixel
        return MomentMatching(jacobian=prediction.jacobian, shift=shift, covariance=covariance)


def moments_after_miss(
    pixel: FloatArray, covariance_px2: FloatArray, image_size_px: tuple[int, int], detection_probability: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean (2,) and covariance (2, 2) of N(pixel, covariance) after a missed detection.

    Bayes: the density inside the image has the weight 1 − P_D, outside 1. With mass m, mean μ and second moment M of
    the part inside, about the prediction, E[d] = −P_D m μ / (1 − P_D m) and E[d dᵀ] = (S − P_D m M) / (1 − P_D m). The
    Gaussian is truncated axis by axis, the one nearer to a border first; the other follows by regression.
    """
    inside, spread, mass = np.zeros(2), covariance_px2.copy(), 1.0
    for axis in sorted((0, 1), key=lambda k: min(pixel[k], image_size_px[k] - pixel[k])):
        variance = max(float(spread[axis, axis]), 1e-12)
        sigma = math.sqrt(variance)
        low = (-0.5 - pixel[axis] - inside[axis]) / sigma
        high = (image_size_px[axis] - 0.5 - pixel[axis] - inside[axis]) / sigma
        share = 0.5 * (math.erf(high / _SQRT2) - math.erf(low / _SQRT2))
        if share < 1e-9:
            return pixel.copy(), covariance_px2.copy()
        shift = (_density(low) - _density(high)) / share
        left = 1.0 + (low * _density(low) - high * _density(high)) / share - shift**2
        follows = spread[:, axis] / variance
        inside = inside + follows * sigma * shift
        spread = spread + np.outer(follows, follows) * variance * (left - 1.0)
        mass *= share
    taken = detection_probability * mass
    mean = -taken * inside / (1.0 - taken)
    second = (covariance_px2 - taken * (spread + np.outer(inside, inside))) / (1.0 - taken)
    covariance = second - np.outer(mean, mean)
    return pixel + mean, 0.5 * (covariance + covariance.T)


def _density(x: float) -> float:
    return math.exp(-0.5 * min(x * x, 1400.0)) / math.sqrt(2.0 * math.pi)
