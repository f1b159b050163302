"""Differences between a head's commands and the target's bearing: aiming errors, stalls, late starts."""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.simulation.parameter_checks import require, require_finite
from groundstation.simulation.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandErrors:
    """Errors of a head's commands; times are true session time in s.

    Attributes
    ----------
    deviation : added to the bearing, pan and tilt in its first two places, rad; None adds nothing.
    stalls : (from, to) in which the head gets no new command, and stays.
    late_until_s : until then the head waits, ``late_by_rad`` (pan, tilt) off the bearing at which it will begin.
    """

    deviation: Trajectory | None = None
    stalls: tuple[tuple[float, float], ...] = ()
    late_until_s: float = -math.inf
    late_by_rad: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        for start, end in self.stalls:
            require(
                end > start, "CommandErrors: stalls", got=f"{start:g} to {end:g} s", wanted="an end after the start"
            )
        for angle in self.late_by_rad:
            require_finite("CommandErrors: late_by_rad", angle)

    def commanded(self, t_s: FloatArray, bearing_rad: FloatArray) -> FloatArray:
        """Return the commands (n, 2) for bearings (n, 2), rad, at rising times (n,)."""
        command = bearing_rad.copy()
        if self.deviation is not None:
            command += self.deviation.position(t_s)[:, :2]
        late = int(np.searchsorted(t_s, self.late_until_s))
        if late:
            command[:late] = command[min(late, t_s.size - 1)] + np.array(self.late_by_rad)
        for start, end in self.stalls:
            first, last = np.searchsorted(t_s, (start, end))
            command[first:last] = command[max(int(first) - 1, 0)]
        return command


NO_COMMAND_ERRORS = CommandErrors()
