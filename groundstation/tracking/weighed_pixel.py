"""A pixel with several hypotheses, weighed by where the filter expects the target point.

The prediction contains what the other cameras show and how the target has moved. What a detector takes for the nose is
wrong for seconds, and a filter that has followed it predicts it: its word counts for no more than `_MOST_LOG_ODDS`, and
its error may be larger than it states.
"""

import math
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.detection.nose_hypotheses import likeliest, mean_square_about
from groundstation.estimation.variance_check import require_definite
from groundstation.geometry.mahalanobis import mahalanobis_squared
from groundstation.messages import Detection

# a prediction makes one hypothesis likelier than another by at most that
_MOST_LOG_ODDS = 1.0


def weighed(
    found: Detection, predicted_px: FloatArray, covariance_px2: FloatArray, image_size_px: tuple[int, int]
) -> Detection:
    """Return a detection at its likeliest point, given the predicted one (2,) and its covariance (2, 2).

    Where that is outside the picture (w, h), no picture shows it: the detection's own point stays, with the mean square
    of all hypotheses about it. Raises `LinAlgError` for a covariance that is not positive definite.
    """
    if not found.hypotheses:
        return found
    fits = []
    for each in found.hypotheses:
        S = covariance_px2 + each.covariance_px2
        require_definite(S, "predicted pixel")
        square = float(mahalanobis_squared(each.pixel - predicted_px, S))
        fits.append(-0.5 * square - 0.5 * math.log(float(np.linalg.det(S))))
    best = max(fits)
    weights = [
        each.probability * math.exp(max(fit - best, -_MOST_LOG_ODDS))
        for each, fit in zip(found.hypotheses, fits, strict=True)
    ]
    hypotheses = tuple(
        replace(each, probability=weight / sum(weights)) for each, weight in zip(found.hypotheses, weights, strict=True)
    )
    (u, v), covariance = likeliest(hypotheses)
    w, h = image_size_px
    if not (-0.5 <= u <= w - 0.5 and -0.5 <= v <= h - 0.5):
        u, v = found.u_px, found.v_px
        covariance = mean_square_about(np.array([u, v]), hypotheses)
    share = float(np.trace(found.noise_px2) / np.trace(found.covariance_px2))
    return replace(
        found,
        u_px=float(u),
        v_px=float(v),
        covariance_px2=covariance,
        noise_px2=share * covariance,
        hypotheses=hypotheses,
    )
