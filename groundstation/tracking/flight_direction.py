"""Which way an aircraft points, as far as its path tells.

A gust moves the path at once and the attitude hardly: stability and whoever flies hold that, so that the direction in
which an aircraft points is that of its path over the last seconds, not that of its velocity now. The velocity of a
filter wanders about besides.
"""

import math

import numpy as np

from groundstation.arrays import FloatArray

_MIN_SPEED_M_S, _SURE_SPEED_M_S, _SIGMAS = 3.0, 8.0, 3.0
_HELD_S = 2.0  # over which gusts bend a path while the attitude is held; near the ground there is no room for them, …
_GUIDED_S = 0.4  # … and who rotates or flares bends the path by the attitude
_LOW_M, _HIGH_M = 1.5, 5.0  # height of the nose above the runway
_FIRST_S = 0.1  # for so long one velocity counts at most
_BENT_RAD = 0.03  # by how much they do; a velocity less certain than that counts less


class FlightDirection:
    """The mean direction of flight over the last seconds."""

    def __init__(self) -> None:
        self._sum = np.zeros(3)
        self._t_s = -math.inf

    def reset(self) -> None:
        """Forget the aircraft."""
        self._sum, self._t_s = np.zeros(3), -math.inf

    def at(self, t_s: float, velocity_m_s: FloatArray, covariance: FloatArray, height_m: float) -> FloatArray | None:
        """Return the unit vector (3,) in which it points, runway frame; None where that is unknown.

        ``velocity_m_s`` (3,) is the filter's at ``t_s``, runway frame, ``covariance`` (3, 3) that of it, m²/s²;
        ``height_m`` is the nose's above the runway. Asked for a time before the last one, it learns nothing.
        """
        speed = math.sqrt(velocity_m_s.dot(velocity_m_s))
        sigma = math.sqrt(max(float(covariance[0, 0] + covariance[1, 1] + covariance[2, 2]), 0.0))
        if speed > max(_SURE_SPEED_M_S, _MIN_SPEED_M_S + _SIGMAS * sigma):
            self._learn(t_s, velocity_m_s / speed, sigma / speed, height_m)
        length = math.sqrt(self._sum.dot(self._sum))
        if length > 0.0:
            # one that comes to a halt still points where it was going
            return self._sum / length
        return velocity_m_s / speed if speed > _MIN_SPEED_M_S else None

    def _learn(self, t_s: float, direction: FloatArray, sigma_rad: float, height_m: float) -> None:
        since_s = t_s - self._t_s
        if since_s <= 0.0:
            return
        high = min(max((height_m - _LOW_M) / (_HIGH_M - _LOW_M), 0.0), 1.0)
        over_s = _GUIDED_S + high * (_HELD_S - _GUIDED_S)
        kept = math.exp(-since_s / over_s)
        # the first direction counts no more than each of the next ones
        weight = -math.expm1(-min(since_s, _FIRST_S) / over_s) / (1.0 + (sigma_rad / _BENT_RAD) ** 2)
        self._sum = kept * self._sum + weight * direction
        self._t_s = t_s
