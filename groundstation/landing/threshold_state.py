"""The target as seen from the landing threshold: along the landing direction, right of the centre line, up."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import Kinematics

# places of the state: position past, right of and above the threshold, m; their rates, m/s
ALONG, RIGHT, UP, ALONG_RATE, RIGHT_RATE, UP_RATE = range(6)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThresholdState:
    """Position and velocity of the target point (the nose) in coordinates of the threshold.

    Attributes
    ----------
    t_s : session time.
    mean : (6,) m along the landing direction past the threshold, right of the centre line, above the threshold; their
        rates, m/s.
    covariance : (6, 6) of the same.
    """

    t_s: float
    mean: FloatArray
    covariance: FloatArray

    def value(self, gradient: FloatArray) -> "LinearValue":
        """Return a linear function gᵀx of the state with its sigma; ``gradient`` (6,)."""
        variance = float(gradient @ self.covariance @ gradient)
        return LinearValue(float(gradient @ self.mean), math.sqrt(max(variance, 0.0)))

    def component(self, place: int, sign: float = 1.0) -> "LinearValue":
        """Return one component, such as `UP`, times a sign, with its sigma."""
        return LinearValue(sign * float(self.mean[place]), math.sqrt(max(float(self.covariance[place, place]), 0.0)))


@dataclass(frozen=True, slots=True)
class LinearValue:
    """A number and its one sigma, in the same unit."""

    value: float
    sigma: float


def threshold_state(runway: LandingRunway, t_s: float, kinematics: Kinematics) -> ThresholdState:
    """Return the target in coordinates of the threshold. Raises `InputError` where a number of it is not finite."""
    axes = runway.axes()
    velocity = axes @ kinematics.velocity_runway_m_s
    mean = np.concatenate([runway.threshold_coordinates(kinematics.position_runway_m), velocity])
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = axes
    covariance = np.asarray(both @ kinematics.covariance @ both.T)
    if not (math.isfinite(t_s) and np.all(np.isfinite(mean)) and np.all(np.isfinite(covariance))):
        raise InputError("landing: estimate", got=f"a number that is not finite at {t_s} s", wanted="finite numbers")
    return ThresholdState(t_s=t_s, mean=mean, covariance=covariance)
