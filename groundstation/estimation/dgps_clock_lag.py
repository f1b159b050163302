"""Lag of the DGPS receiver's clock: a state of the filter, and the detection of its steps.

A position that is late by δ lies δ·v further along the flight; offset and drift of δ are states of the filter where the
prior has them. A clock that steps by δ moves each position by δ·v, along the flight only. Between two positions the
filter predicts the aircraft to some decimetres, and therefore detects steps that are too small to be rejected for
long: the innovation variance grows meanwhile, so that they would pass the gate and move the track.
"""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.parameters import DGPS_CLOCK
from groundstation.estimation.state_model import StateLayout
from groundstation.geometry.chi_square import chi_square_quantile

# a shift along the flight by so many sigmas is a step: one white innovation in 370, and inflation costs little
_STEP_SIGMAS = 3.0
# across the flight the position has to agree with the prediction
_ACROSS_GATE = float(chi_square_quantile(0.9995, 2))


class DgpsClockLag:
    """Indices of the clock's offset and drift in the state; both are None if the clock is taken as exact."""

    def __init__(self, layout: StateLayout) -> None:
        self.offset = layout.parameters.get(f"{DGPS_CLOCK}.offset")
        self.drift = layout.parameters.get(f"{DGPS_CLOCK}.drift")

    def lag_s(self, x: FloatArray, ahead_s: float, age_s: float) -> float:
        """Return the time from the state (n,) to the validity of a position stamped ``ahead_s`` after it."""
        lag = ahead_s
        if self.offset is not None:
            lag += float(x[self.offset])
        if self.drift is not None:
            lag += age_s * float(x[self.drift])
        return lag

    def lag_and_sigma_s(self, x: FloatArray, P: FloatArray, ahead_s: float, age_s: float) -> tuple[float, float]:
        """Return `lag_s` and its sigma."""
        mean, variance = ahead_s, 0.0
        for place, lever in ((self.offset, 1.0), (self.drift, age_s)):
            if place is not None:
                mean += lever * float(x[place])
                variance += lever**2 * float(P[place, place])
        return mean, float(np.sqrt(variance))


def has_clock_stepped(residual_m: FloatArray, covariance_m2: FloatArray, velocity_m_s: FloatArray) -> bool:
    """Return whether a residual (3,) with innovation covariance (3, 3) is a shift in time along ``velocity_m_s`` (3,).

    With S the covariance, the best fitting shift differs from zero by z = vᵀS⁻¹r / √(vᵀS⁻¹v) sigmas, and
    rᵀS⁻¹r − z² is what it does not explain, χ² with two degrees of freedom.
    """
    weighted = np.linalg.solve(covariance_m2, np.column_stack([velocity_m_s, residual_m]))
    length = float(velocity_m_s @ weighted[:, 0])
    if length <= 0.0:
        return False
    square = float(velocity_m_s @ weighted[:, 1]) ** 2 / length
    return square > _STEP_SIGMAS**2 and float(residual_m @ weighted[:, 1]) - square <= _ACROSS_GATE
