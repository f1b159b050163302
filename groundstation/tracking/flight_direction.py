"""Heading of the aircraft, estimated from its path.

A gust changes the path at once but hardly the attitude, which is held by stability and pilot. The aircraft therefore
points along its path over the last seconds rather than along its current velocity, whose estimate is also noisier.
"""

import math

import numpy as np

from groundstation.arrays import FloatArray

_MIN_SPEED_M_S, _SURE_SPEED_M_S, _SIGMAS = 3.0, 8.0, 3.0
_HELD_S = 2.0  # averaging time in flight, where gusts bend the path and the attitude is held
_GUIDED_S = 0.4  # averaging time near the ground, where rotation and flare bend the path through the attitude
_LOW_M, _HIGH_M = 1.5, 5.0  # height of the nose above the runway
_NEW_S = 1.5  # a velocity by wrong fixes is corrected by then, where three cameras see the target
_FIRST_S = 0.1  # maximum weight of a single velocity, as a time
_BENT_RAD = 0.03  # size of the path deviations; a velocity less certain than this gets less weight


class FlightDirection:
    """The mean direction of flight over the last seconds."""

    def __init__(self) -> None:
        self.sigma_rad = math.inf
        """One sigma of the heading that `at` has returned; infinite while the target is new.

        A target that was found by wrong fixes has a velocity that is wrong, whatever its covariance, until it is
        corrected.
        """
        self._sum = np.zeros(3)
        self._sigma_sum_rad = self._weight = 0.0
        self._t_s = -math.inf
        self._began_s: float | None = None

    def reset(self) -> None:
        """Reset for a new target."""
        self._sum, self._t_s = np.zeros(3), -math.inf
        self._sigma_sum_rad = self._weight = 0.0
        self._began_s = None

    def at(self, t_s: float, velocity_m_s: FloatArray, covariance: FloatArray, height_m: float) -> FloatArray | None:
        """Return the unit vector (3,) of the heading, runway frame; None where it is unknown.

        ``velocity_m_s`` (3,) is the filter's velocity at ``t_s``, runway frame, ``covariance`` (3, 3) its covariance,
        m²/s²; ``height_m`` is the height of the nose above the runway. Times before the newest one do not update it.
        """
        self._began_s = t_s if self._began_s is None else self._began_s
        speed = math.sqrt(velocity_m_s.dot(velocity_m_s))
        sigma = math.sqrt(max(float(covariance[0, 0] + covariance[1, 1] + covariance[2, 2]), 0.0))
        if speed > max(_SURE_SPEED_M_S, _MIN_SPEED_M_S + _SIGMAS * sigma):
            self._learn(t_s, velocity_m_s / speed, sigma / speed, height_m)
        length = math.sqrt(self._sum.dot(self._sum))
        is_new = t_s - self._began_s < _NEW_S
        if length > 0.0:
            # an aircraft that has stopped keeps its heading; errors of successive velocities are alike
            self.sigma_rad = math.inf if is_new else self._sigma_sum_rad / self._weight
            return self._sum / length
        self.sigma_rad = math.inf if is_new else sigma / max(speed, _MIN_SPEED_M_S)
        return velocity_m_s / speed if speed > _MIN_SPEED_M_S else None

    def _learn(self, t_s: float, direction: FloatArray, sigma_rad: float, height_m: float) -> None:
        since_s = t_s - self._t_s
        if since_s <= 0.0:
            return
        high = min(max((height_m - _LOW_M) / (_HIGH_M - _LOW_M), 0.0), 1.0)
        over_s = _GUIDED_S + high * (_HELD_S - _GUIDED_S)
        kept = math.exp(-since_s / over_s)
        # the first direction gets no more weight than each of the following ones
        weight = -math.expm1(-min(since_s, _FIRST_S) / over_s) / (1.0 + (sigma_rad / _BENT_RAD) ** 2)
        self._sum = kept * self._sum + weight * direction
        self._weight = kept * self._weight + weight
        self._sigma_sum_rad = kept * self._sigma_sum_rad + weight * sigma_rad
        self._t_s = t_s
