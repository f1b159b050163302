"""A part of a flight by time and position, for the availability of DGPS and the misses of a camera."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, MaskArray


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightWindow:
    """All that is within these limits: true session time in s; y and z of the target, runway frame, m."""

    from_s: float = -math.inf
    to_s: float = math.inf
    min_y_m: float = -math.inf
    max_y_m: float = math.inf
    min_z_m: float = -math.inf
    max_z_m: float = math.inf

    def holds(self, t_s: FloatArray, position_runway_m: FloatArray) -> MaskArray:
        """Return which of n times (n,) and positions (n, 3) are inside, limits included."""
        y, z = position_runway_m[:, 1], position_runway_m[:, 2]
        return np.asarray(
            (self.from_s <= t_s)
            & (t_s <= self.to_s)
            & (self.min_y_m <= y)
            & (y <= self.max_y_m)
            & (self.min_z_m <= z)
            & (z <= self.max_z_m)
        )
