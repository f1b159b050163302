"""Weight of a pixel near and beyond the image border.

The consistent weight is the predicted probability mass inside the image; the paper's is 1 inside and falls
with the prediction's distance beyond the border.
"""

import math

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
    """Return the mass between −½ and the image's size − ½ in both axes."""
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
