"""Probability that the target is inside the image.

The consistent weight is the predicted probability mass inside the image; the paper's is 1 inside and falls
with the prediction's distance beyond the border.
"""

import math

import numpy as np
from numba import njit

from groundstation.arrays import FloatArray

_SQRT2 = math.sqrt(2.0)


def probability_in_view(pixel: FloatArray, covariance_px2: FloatArray, image_size_px: tuple[int, int]) -> float:
    """Return the mass of N(pixel, covariance) inside the image, as the product of its two marginals.

    ``pixel`` (2,), ``covariance_px2`` (2, 2). The correlation of u and v is neglected: it moves mass along
    the border, not across it.
    """
    return float(_mass_inside(pixel, covariance_px2, image_size_px[0], image_size_px[1]))


@njit(cache=True)
def _mass_inside(pixel: FloatArray, covariance: FloatArray, width: int, height: int) -> float:
    """Return the mass between −½ and the image's size − ½ of both axes."""
    mass = 1.0
    for axis in range(2):
        sigma = math.sqrt(max(covariance[axis, axis], 1e-12))
        low = (-0.5 - pixel[axis]) / (sigma * _SQRT2)
        high = ((width if axis == 0 else height) - 0.5 - pixel[axis]) / (sigma * _SQRT2)
        mass *= 0.5 * (math.erf(high) - math.erf(low))
    return mass


def paper_weight(pixel: FloatArray, image_size_px: tuple[int, int], border_sigma_px: float) -> float:
    """Return the paper's T: 1 inside the image, exp(−d²/2s²) at distance d beyond its border."""
    outside = [max(-0.5 - pixel[axis], pixel[axis] - (image_size_px[axis] - 0.5), 0.0) for axis in range(2)]
    distance = math.hypot(*outside)
    return math.exp(-(distance**2) / (2.0 * border_sigma_px**2))


def moments_after_miss(
    pixel: FloatArray, covariance_px2: FloatArray, image_size_px: tuple[int, int], detection_probability: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean (2,) and covariance (2, 2) of N(pixel, covariance) once a look has found nothing.

    Bayes: what lies inside the image weighs 1 − P_D, what lies outside 1. With the inside's mass m, mean μ and
    second moment M about the prediction, E[d] = −P_D m μ / (1 − P_D m) and E[d dᵀ] = (S − P_D m M) / (1 − P_D m). The
    inside is cut from the Gaussian axis by axis, the narrower first, the other axis following by regression.
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
