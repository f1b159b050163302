"""Limits of a pan-tilt unit; apart from the pointing law, whose libraries the PTUs' process starts without."""

import math
from dataclasses import dataclass

# a unit that reports no lease: the default watchdog of the drivers, or the motion guard
LEASE_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisLimits:
    """What one axis may do: rad, rad/s, rad/s²; ``slowest_rad_s`` is the least speed that is not standing still."""

    low_rad: float = -math.inf
    high_rad: float = math.inf
    fastest_rad_s: float = math.inf
    slowest_rad_s: float = 0.0
    acceleration_rad_s2: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadLimits:
    """Limits of the two axes of a PTU; it holds a rate for at most ``lease_s`` after the last command."""

    pan: AxisLimits
    tilt: AxisLimits
    lease_s: float = LEASE_S
