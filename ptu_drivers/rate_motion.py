"""Motion by rate that was commanded: has it room, is it overdue, will it pass a limit?"""

from dataclasses import dataclass

from ptu_drivers.axis_limits import check_rate, check_room
from ptu_drivers.messages import Axis, Reading, UnitDescription

# until it is looked at again and has come to rest
_AHEAD_S = 0.25


@dataclass(slots=True, kw_only=True)
class RateMotion:
    """The rates that are in force.

    Attributes
    ----------
    description : the axes with their limits.
    rates : rad/s by axis, 0 for an axis that stands; None while no rates are in force.
    commanded_s : when they were commanded, s.
    """

    description: UnitDescription
    rates: dict[Axis, float] | None = None
    commanded_s: float = 0.0

    def begin(self, asked: dict[Axis, float], now_s: float, last: Reading | None) -> None:
        """Take new rates, rad/s, if the axes may turn so fast and have room, as far as is known. Raises LimitError."""
        for axis, value in asked.items():
            check_rate(axis, self.description.axis(axis), value)
            if last is not None and not (self.rates and self.rates[axis]):
                # from rest; motion is stopped at its limit anyway
                ahead_rad = last.axis(axis).angle_rad + value * _AHEAD_S
                check_room(axis, self.description.axis(axis), ahead_rad, value)
        self.rates, self.commanded_s = asked, now_s

    def end(self) -> None:
        """Forget the rates: another command replaced them, or they are to be halted."""
        self.rates = None

    def turns(self) -> bool:
        """Return whether an axis turns."""
        return self.rates is not None and any(self.rates.values())

    def is_overdue(self, now_s: float, watchdog_s: float) -> bool:
        """Return whether it goes on though no command came for `watchdog_s`; 0 is for ever."""
        return self.turns() and watchdog_s > 0 and now_s - self.commanded_s > watchdog_s

    def nears_limit(self, reading: Reading, now_s: float) -> bool:
        """Return whether an axis would pass its limit before the next look."""
        for axis, rate in (self.rates or {}).items():
            sample, said = reading.axis(axis), self.description.axis(axis)
            ahead = sample.angle_rad + rate * (now_s - sample.t_s + _AHEAD_S)
            if (rate > 0 and ahead > said.high_rad) or (rate < 0 and ahead < said.low_rad):
                return True
        return False
