"""The error of the detected point on an aircraft that the detector has not seen before.

It is about the same in all pictures of a flight, so that no filter averages it away and no residual shows it: the
estimate's covariance is enlarged by it at the output.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.messages import Kinematics


def point_sigma_m(
    kinematics: Kinematics,
    span_m: float,
    sigma_spans: FloatArray,
    behind_spans: FloatArray,
    eyes_m: Sequence[FloatArray],
) -> FloatArray:
    """Return one sigma of the detected point forward, to the right and upward on the aircraft, m, (3,).

    ``sigma_spans`` (3,) is that of an aircraft that flies towards cameras at ``eyes_m``, (3,) each; one that flies away
    hides its nose, and where that is inferred to be is wrong by ``behind_spans`` (3,) more, straight from behind, and
    by nothing across the line of sight.
    """
    sigma_m = span_m * sigma_spans
    velocity_m_s = kinematics.velocity_runway_m_s
    speed_m_s = float(np.linalg.norm(velocity_m_s))
    if speed_m_s == 0.0 or not eyes_m:
        return sigma_m
    away = [_cosine(velocity_m_s, kinematics.position_runway_m - eye_m) for eye_m in eyes_m]
    behind2 = float(np.mean(np.square(np.maximum(away, 0.0))))
    return np.asarray(np.sqrt(sigma_m**2 + (span_m * behind_spans) ** 2 * behind2))


def _cosine(a: FloatArray, b: FloatArray) -> float:
    return float(a @ b) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-12)


def with_point_error(kinematics: Kinematics, sigma_m: FloatArray) -> Kinematics:
    """Return an estimate whose position covers the detected point's error.

    ``sigma_m`` (3,) is one sigma of it forward, to the right and upward on the aircraft, m. The aircraft's axes are
    those of its path, so that a small crab angle is neglected; while the direction of the velocity is uncertain, the
    error counts in every horizontal direction.
    """
    forward, right, up = (float(s) ** 2 for s in sigma_m)
    horizontal_m_s = kinematics.velocity_runway_m_s[:2]
    speed2 = float(horizontal_m_s @ horizontal_m_s)
    noise2 = max(float(np.trace(kinematics.covariance[3:5, 3:5])), 0.0)
    spread = np.eye(2) / 2.0
    if speed2 > 0.0:
        # of the direction's second moment, what is known of it
        known = speed2 / (speed2 + noise2)
        spread = known * np.outer(horizontal_m_s, horizontal_m_s) / speed2 + (1.0 - known) * spread
    covariance = kinematics.covariance.copy()
    covariance[:2, :2] += right * np.eye(2) + (forward - right) * spread
    covariance[2, 2] += up
    return replace(kinematics, covariance=covariance)
