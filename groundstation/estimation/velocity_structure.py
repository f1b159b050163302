"""How much the target's velocity changes in a time: its structure function, learnt while two cameras see it.

White acceleration of the configured density describes an approach; other aircraft turn harder, and longer in one
direction. While a single camera sees the target its range follows from this motion alone, so the density is then taken
from the changes of velocity that were seen: D(T) = E[(v(t + T) − v(t))²], the second-order structure function.
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from groundstation.arrays import FloatArray

LAGS_S = (1.0, 2.0, 4.0, 8.0)
_SPACING_S = 0.5
# the aircraft is the same but the phase of flight is not: older changes count less
_MEMORY_S = 60.0
# so many independent changes at a lag are needed before its mean square says something
_LEAST_CHANGES = 3.0
# m/s: a velocity less certain than this is not sampled
_LARGEST_SIGMA_M_S = 2.0
# a long step's density is the mean of so many
_STEPS = 16


class _Sample(NamedTuple):
    t_s: float
    velocity_m_s: FloatArray
    variance: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VelocityStructure:
    """The structure function of a target's velocity, and of those before it; replaced, never written to.

    Attributes
    ----------
    samples : of the last seconds, oldest first.
    sums : (lags, 3) weighted sums of squared changes along x, y, z, less the noise of their velocities, m²/s².
    weights : (lags,) of these sums, in independent changes.
    """

    samples: tuple[_Sample, ...] = ()
    sums: FloatArray = field(default_factory=lambda: np.zeros((len(LAGS_S), 3)))
    weights: FloatArray = field(default_factory=lambda: np.zeros(len(LAGS_S)))

    def interrupted(self) -> "VelocityStructure":
        """Return the function for another track, most likely of the same aircraft: what was learnt stays."""
        return replace(self, samples=())

    def is_due(self, t_s: float) -> bool:
        """Return whether a sample at ``t_s`` would be used."""
        return not self.samples or t_s >= self.samples[-1].t_s + _SPACING_S

    def sampled(self, t_s: float, velocity_m_s: FloatArray, covariance: FloatArray) -> "VelocityStructure":
        """Return the function with a velocity (3,) at ``t_s``, whose covariance is (3, 3), m²/s²."""
        variance = np.diag(covariance).copy()
        if float(variance.max()) > _LARGEST_SIGMA_M_S**2:
            return self
        now = _Sample(t_s, velocity_m_s.copy(), variance)
        kept = math.exp(-_SPACING_S / _MEMORY_S)
        sums, weights = kept * self.sums, kept * self.weights
        for k, lag_s in enumerate(LAGS_S):
            then = next((s for s in self.samples if abs(t_s - s.t_s - lag_s) <= 0.5 * _SPACING_S), None)
            if then is None:
                continue
            change = now.velocity_m_s - then.velocity_m_s
            # changes over overlapping times are not independent
            share = _SPACING_S / lag_s
            sums[k] += share * (change**2 - now.variance - then.variance)
            weights[k] += share
        recent = tuple(s for s in self.samples if t_s - s.t_s < LAGS_S[-1] + _SPACING_S)
        return VelocityStructure(samples=(*recent, now), sums=sums, weights=weights)

    def mean_density(self, from_s: float, to_s: float) -> FloatArray:
        """Return the mean of `density` (3,) between two ages, s."""
        if to_s - from_s <= LAGS_S[0]:
            return self.density(0.5 * (from_s + to_s))
        steps = from_s + (np.arange(_STEPS) + 0.5) * (to_s - from_s) / _STEPS
        return np.asarray(np.mean([self.density(float(age)) for age in steps], axis=0))

    def density(self, age_s: float) -> FloatArray:
        """Return the density (3,) of white acceleration ``age_s`` after the velocity was last known, m²/s³.

        It is the slope of D there, so that the velocity's variance grows as D does. Zero where nothing is known. A
        change seen along one horizontal axis may be along the other next time.
        """
        known = [k for k in range(len(LAGS_S)) if self.weights[k] >= _LEAST_CHANGES]
        if not known:
            return np.zeros(3)
        below_s, below = 0.0, np.zeros(3)
        for k in known:
            here = np.maximum(self.sums[k] / self.weights[k], 0.0)
            here[:2] = np.maximum(here[:2], here[:2].mean())
            if age_s < LAGS_S[k]:
                return np.maximum((here - below) / (LAGS_S[k] - below_s), 0.0)
            below_s, below = LAGS_S[k], here
        # beyond the longest lag: the velocity may have come to its limit, but a straight path would give away a range
        return below / below_s
