"""Angles and rates of a FLIR unit in counts, and its stopping distance."""

import math
from dataclasses import dataclass

from ptu_drivers.errors import LimitError
from ptu_drivers.flir.probe import UnitFacts
from ptu_drivers.messages import Axis, Reading, UnitDescription
from ptu_drivers.settings import AxisSettings, UnitSettings

# a command arrives and is obeyed within that time, s
_OBEY_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Converter:
    """Angles and rates to counts, and back."""

    facts: UnitFacts
    description: UnitDescription
    settings: UnitSettings

    def of(self, axis: Axis) -> AxisSettings:
        """Return the settings of one axis."""
        return self.settings.pan if axis is Axis.PAN else self.settings.tilt

    def angle(self, axis: Axis, counts: int) -> float:
        """Return the angle of a position, rad."""
        return self.of(axis).angle(counts * self.facts.axis(axis).quantum_rad)

    def counts(self, axis: Axis, angle_rad: float) -> float:
        """Return an angle in counts, not rounded."""
        return self.of(axis).unit_angle(angle_rad) / self.facts.axis(axis).quantum_rad

    def bounds(self, axis: Axis) -> tuple[int, int]:
        """Return the first and last position inside all limits, counts."""
        a, facts = self.description.axis(axis), self.facts.axis(axis)
        low, high = sorted((self.counts(axis, a.low_rad), self.counts(axis, a.high_rad)))
        # the unit's own ends come back from radians with their last digits changed
        return max(math.ceil(low - 1e-6), facts.low), min(math.floor(high + 1e-6), facts.high)

    def position(self, axis: Axis, unit_rad: float) -> int:
        """Return the position of the unit's own angle, rad, in counts."""
        facts = self.facts.axis(axis)
        return min(max(round(unit_rad / facts.quantum_rad), facts.low), facts.high)

    def rate(self, axis: Axis, unit_rad_s: float) -> int:
        """Return a signed rate, counts/s, of the unit's own, rad/s, which is 0 or within its bounds."""
        if unit_rad_s == 0.0:
            return 0
        facts = self.facts.axis(axis)
        size = min(max(round(abs(unit_rad_s) / facts.quantum_rad), facts.min_rate), facts.max_rate)
        return int(math.copysign(size, unit_rad_s))

    def reach(self, axis: Axis, reading: Reading, rate_rad_s: float) -> float:
        """Return where the axis would come to rest after a stop command now, rad."""
        a = self.description.axis(axis)
        at = reading.pan if axis is Axis.PAN else reading.tilt
        braking = rate_rad_s * abs(rate_rad_s) / (2.0 * a.max_acceleration_rad_s2)
        return at.angle_rad + braking + rate_rad_s * _OBEY_S

    def outward(self, axis: Axis, reading: Reading, rate_rad_s: float) -> LimitError | None:
        """Return the limit that motion at this rate is about to pass, if any."""
        a = self.description.axis(axis)
        reach = self.reach(axis, reading, rate_rad_s)
        if rate_rad_s > 0 and reach >= a.high_rad:
            return LimitError(axis.value, "upper limit", got=reach, bound=a.high_rad, origin=a.high_from)
        if rate_rad_s < 0 and reach <= a.low_rad:
            return LimitError(axis.value, "lower limit", got=reach, bound=a.low_rad, origin=a.low_from)
        return None
