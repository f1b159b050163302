"""Pointing around keep-out zones of a lens: rates that approach none, and waiting positions.

Commands that the unit would refuse (`groundstation.live.keep_out_unit`) are avoided: the margin is wider, and rates
towards a zone are limited to those from which the head still stops before it.
"""

import math

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.pointing.detour import Detour, DetourPlanner, slope_of
from groundstation.pointing.keep_out import ClosedZones, KeepOut, rates_are_clear

# margin of the planned path and of the rates; the unit's own margin is smaller than both
PLAN_MARGIN_RAD = math.radians(1.0)
_RATE_MARGIN_RAD = math.radians(0.6)
# in addition to the unit's lease, the longest time at a rate before the head brakes: its period and a late reading
_LATE_S = 0.4
_UNKNOWN_BRAKES_RAD_S2 = math.radians(30.0)
_SHARES = (1.0, 0.6, 0.3, 0.1)
_STEP_SHARES = (*_SHARES, 0.03, 0.01)


class KeepOutController:
    """Keep-out rules of one head.

    Parameters
    ----------
    keep_out : at session times.
    lows_rad, highs_rad, brakes_rad_s2 : (2,) of pan and tilt; infinite where the unit does not report them.
    lease_s : the time for which the unit holds a rate after the last command.
    """

    def __init__(
        self,
        keep_out: KeepOut,
        lows_rad: FloatArray,
        highs_rad: FloatArray,
        brakes_rad_s2: FloatArray,
        *,
        lease_s: float = 0.5,
    ) -> None:
        self.held = ""
        """Where the head is held, in words; "" while it is not."""
        self._keep_out = keep_out
        self._held_s = lease_s + _LATE_S
        self._brakes = np.where(np.isfinite(brakes_rad_s2), brakes_rad_s2, _UNKNOWN_BRAKES_RAD_S2)
        self._ways = DetourPlanner(lows_rad, highs_rad, PLAN_MARGIN_RAD)
        self._commanded_rad_s = np.zeros(2)

    def zones(self, t_s: float) -> ClosedZones:
        """Return the closed zones at a session time."""
        return self._keep_out.zones(t_s)

    def allows(self, t_s: float, angles_rad: tuple[float, float]) -> bool:
        """Return whether the head may point at (pan, tilt) at that time."""
        return self.zones(t_s).at(angles_rad) >= PLAN_MARGIN_RAD

    def next(self, t_s: float, here_rad: FloatArray, wanted_rad: FloatArray) -> Detour:
        """Return where to turn from angles (2,) to get to others; notes where the head is ``held``."""
        zones = self.zones(t_s)
        self.held = ""
        if zones.is_empty:
            return Detour(angles_rad=wanted_rad, reaches=True)
        found = self._ways.next(t_s, zones, here_rad, wanted_rad)
        wanted = (float(wanted_rad[0]), float(wanted_rad[1]))
        if zones.at(wanted) < PLAN_MARGIN_RAD:
            self.held = f"held outside {zones.words((float(here_rad[0]), float(here_rad[1])))}"
        elif not found.reaches and np.array_equal(found.angles_rad, here_rad):
            self.held = f"held: no way round {zones.words(wanted)}"
        return found

    def slowed(self, t_s: float, here_rad: FloatArray, rates_rad_s: FloatArray) -> FloatArray:
        """Return as much of rates (2,) as lets the head stop before any zone, or leave the one that it is in."""
        zones = self.zones(t_s)
        if zones.is_empty:
            return rates_rad_s
        for share in _SHARES:
            ways = (
                [self._commanded_rad_s, share * rates_rad_s] if np.any(self._commanded_rad_s) else [share * rates_rad_s]
            )
            if rates_are_clear(zones, here_rad, ways, self._held_s, self._brakes, _RATE_MARGIN_RAD):
                return share * rates_rad_s
        return np.zeros(2)

    def set_commanded(self, rates_rad_s: FloatArray) -> None:
        """Note the rates (2,) that were commanded."""
        self._commanded_rad_s = rates_rad_s

    def step_towards(self, t_s: float, here_rad: FloatArray, goal_rad: FloatArray) -> FloatArray:
        """Return angles (2,) on the way to others that a unit may be sent to, whichever axis is the faster."""
        zones = self.zones(t_s)
        here = (float(here_rad[0]), float(here_rad[1]))
        for share in _STEP_SHARES:
            there = here_rad + share * (goal_rad - here_rad)
            if zones.box_is_clear(here, (float(there[0]), float(there[1])), _RATE_MARGIN_RAD):
                return np.asarray(there)
        return here_rad

    def turned_aside(self, t_s: float, here: FloatArray, rates: FloatArray) -> FloatArray:
        """Return rates (2,) whose part towards the nearest zone can be braked in the room that is left before it."""
        zones = self.zones(t_s)
        if zones.is_empty:
            return rates
        room = zones.at((float(here[0]), float(here[1]))) - PLAN_MARGIN_RAD
        slope = slope_of(zones, here)
        size = float(slope @ slope)
        if size < 1e-6:
            return rates
        brakes = float(self._brakes.min())
        late = brakes * (self._held_s + 0.1)
        least = late - math.sqrt(late * late + 2.0 * brakes * room) if room > 0.0 else -room
        lacking = least - float(slope @ rates)
        return rates if lacking <= 0.0 else rates + lacking / size * slope
