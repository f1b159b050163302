"""What lasts over a flight, learnt from heights that come from elsewhere.

Of a runway wider than announced each picture gives a pose that is too near and too low, by the same share: pictures
alone do not show it, and a straight glide does not either. A barometer, or a navigation, knows the height's course; by
how much more or less the trajectory descends than it tells the width. It is one of the lasting errors θ of unit
variance whose effect on the filter's state is the sensitivity S of `consider_parameters`. What is off in height is

    filter's z − known z = S_z θ + e − b + noise,

b being the known height's own constant error and e that of the filter, which changes within seconds: a Gauss–Markov
process of the variance that the filter states. A Kalman filter estimates θ, b and e; what the heights tell of θ is off
by e, so that θ and e are known together better than each alone. The state is corrected by S θ and by what goes with e,
and its covariance is that of all three. Without heights θ stays 0 with unit covariance.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray

# which of the estimated errors is that of the known height
_KNOWN = -2
_LEAST_M2 = 1e-12


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
        # after the errors the constant error of the known height and the filter's own error in height, m
        self._x, self._P = np.zeros(count + 2), np.eye(count + 2)
        self._P[-1, -1] = self._variance_m2 = 0.0
        self._memory_s = memory_s
        self._last_s: float | None = None

    @property
    def mean(self) -> FloatArray:
        """Return the errors (count,) in their sigmas."""
        return self._x[:-2]

    @property
    def covariance(self) -> FloatArray:
        """Return their covariance (count, count)."""
        return self._P[:-2, :-2]

    def update(
        self, t_s: float, off_m: float, sensitivity_m: FloatArray, variance_m2: float, known: KnownHeight
    ) -> None:
        """Take by how much the filter is higher than is known, with what one sigma of each error makes of it, (count,).

        ``variance_m2`` of the filter's own height.
        """
        if self._last_s is not None and t_s <= self._last_s:
            return
        if self._last_s is None:
            self._P[_KNOWN, _KNOWN] = known.lasting_m**2
        self._x, self._P = self._at(t_s, variance_m2)
        self._last_s, self._variance_m2 = t_s, variance_m2
        h, noise = np.concatenate([sensitivity_m, [-1.0, 1.0]]), known.noise_m**2
        Ph = self._P @ h
        variance = float(h @ Ph) + noise
        gain = Ph / variance
        self._x = self._x + gain * (off_m - float(h @ self._x))
        kept = np.eye(h.size) - np.outer(gain, h)
        self._P = kept @ self._P @ kept.T + noise * np.outer(gain, gain)

    def restart(self) -> None:
        """Forget the filter's own error: it has started from another state, and what lasts is as it was."""
        self._x[-1] = self._variance_m2 = 0.0
        self._P[-1] = self._P[:, -1] = 0.0

    def corrected(self, t_s: float, sensitivity: FloatArray, own: FloatArray, up: int) -> tuple[FloatArray, FloatArray]:
        """Return what a state (n,) is off by as far as that has been learnt, and the covariance (n, n) of the rest.

        ``sensitivity`` (n, count), ``own`` (n, n) the filter's covariance of the state, whose height is number ``up``.
        """
        variance = float(own[up, up])
        x, P = self._at(t_s, variance)
        kept = np.append(np.arange(x.size - 2), x.size - 1)
        # what of the state's own error goes with its height's, and what does not
        with_height = own[:, up] / max(variance, _LEAST_M2)
        G = np.column_stack([sensitivity, with_height])
        alone = own - variance * np.outer(with_height, with_height)
        return G @ x[kept], alone + G @ P[np.ix_(kept, kept)] @ G.T

    def _at(self, t_s: float, variance_m2: float) -> tuple[FloatArray, FloatArray]:
        """Return mean and covariance at a time at which the filter's own height has this variance."""
        x, P = self._x.copy(), self._P.copy()
        kept, scale = 0.0, 0.0
        if self._last_s is not None and self._variance_m2 > _LEAST_M2:
            # correlated so, heights count in the sum as one in each ``memory_s``
            kept = math.exp(-2.0 * (t_s - self._last_s) / self._memory_s)
            scale = kept * math.sqrt(variance_m2 / self._variance_m2)
        x[-1] *= scale
        P[-1] *= scale
        P[:, -1] *= scale
        P[-1, -1] += (1.0 - kept**2) * variance_m2
        return x, P
