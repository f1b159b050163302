"""The error of the detected point on an aircraft that the detector has not seen before.

It is about the same in all pictures of a flight, so that no filter averages it away and no residual shows it: the
estimate's covariance is enlarged by it at the output.
"""

from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.messages import Kinematics


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
