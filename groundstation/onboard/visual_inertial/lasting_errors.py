"""What lasts over a flight, learnt from heights that come from elsewhere.

Of a runway wider than announced each picture gives a pose that is too near and too low, by the same share: pictures
alone do not show it, and a straight glide does not either. A barometer, or a navigation, knows the height's course; by
how much more or less the trajectory descends than it tells the width. It is one of the lasting errors θ of unit
variance whose effect on the filter's state is the sensitivity S of `consider_parameters`. What is off in height is

    filter's z − known z = S_z θ − b + noise,

b being the known height's own constant error. A Kalman filter without motion estimates θ and b; the state is corrected
by S θ, and its covariance is P + S P_θ Sᵀ. Without heights θ stays 0 with unit covariance.
"""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownHeight:
    """The camera's height above the threshold at a picture, m; sigmas of its constant error and of its noise, m."""

    up_m: float
    lasting_m: float
    noise_m: float


class LastingErrors:
    """Mean and covariance of a flight's lasting errors, of which each has one sigma before any height.

    Parameters
    ----------
    count : of them.
    memory_s : for how long the filter's own error in height stays about the same: heights within it count as one
        against it.
    """

    def __init__(self, count: int, memory_s: float) -> None:
        # the last one is the constant error of the known height, m
        self._x, self._P = np.zeros(count + 1), np.eye(count + 1)
        self._memory_s = memory_s
        self._last_s: float | None = None

    @property
    def mean(self) -> FloatArray:
        """Return the errors (count,) in their sigmas."""
        return self._x[:-1]

    @property
    def covariance(self) -> FloatArray:
        """Return their covariance (count, count)."""
        return self._P[:-1, :-1]

    def update(
        self, t_s: float, off_m: float, sensitivity_m: FloatArray, variance_m2: float, known: KnownHeight
    ) -> None:
        """Take by how much the filter is higher than is known, with what one sigma of each error makes of it, (count,).

        ``variance_m2`` of the filter's own height.
        """
        if self._last_s is None:
            self._P[-1, -1] = known.lasting_m**2
            apart_s = self._memory_s
        else:
            apart_s = t_s - self._last_s
        if apart_s <= 0.0:
            return
        self._last_s = t_s
        h = np.append(sensitivity_m, -1.0)
        noise = known.noise_m**2 + variance_m2 * max(1.0, self._memory_s / apart_s)
        Ph = self._P @ h
        variance = float(h @ Ph) + noise
        gain = Ph / variance
        self._x = self._x + gain * (off_m - float(h @ self._x))
        kept = np.eye(h.size) - np.outer(gain, h)
        self._P = kept @ self._P @ kept.T + noise * np.outer(gain, gain)
