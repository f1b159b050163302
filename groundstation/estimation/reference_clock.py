"""Detection of a clock step of a reference receiver from the residual along the velocity.

A clock that steps by δ moves each position by δ·v, forward or back along the flight and nowhere else. Between two
positions the filter knows the way of the aircraft to some decimetres, and so sees steps that are far too small to be
refused for long: with the variance of the innovation that grows meanwhile they would pass the gate, and move the track.
"""

import numpy as np
from scipy.stats import chi2

from groundstation.arrays import FloatArray
from groundstation.estimation.parameters import DGPS_CLOCK

REFERENCE_CLOCK = f"{DGPS_CLOCK}.offset"
# as many sigmas along the flight are a step: of white innovations one in 370, and opening the clock costs little
_STEP_SIGMAS = 3.0
# across it the position has to be where it was expected
_ACROSS_GATE = float(chi2.ppf(0.9995, 2))


def has_stepped(residual_m: FloatArray, covariance_m2: FloatArray, velocity_m_s: FloatArray) -> bool:
    """Return whether a residual (3,) with innovation covariance (3, 3) is a shift in time along ``velocity_m_s`` (3,).

    With S the covariance, the shift that fits best is off zero by z = vᵀS⁻¹r / √(vᵀS⁻¹v) sigmas, and
    rᵀS⁻¹r − z² is what it leaves over, χ² of two degrees of freedom.
    """
    weighted = np.linalg.solve(covariance_m2, np.column_stack([velocity_m_s, residual_m]))
    length = float(velocity_m_s @ weighted[:, 0])
    if length <= 0.0:
        return False
    square = float(velocity_m_s @ weighted[:, 1]) ** 2 / length
    return square > _STEP_SIGMAS**2 and float(residual_m @ weighted[:, 1]) - square <= _ACROSS_GATE
