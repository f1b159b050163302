"""Motion by rate that was commanded: has it room, is it overdue, will it pass a limit?"""

from dataclasses import dataclass

from ptu_drivers.axis_limits import check_room
from ptu_drivers.messages import Axis, Reading, UnitDescription

# until it is checked again and has come to rest
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

    def from_rest(self, asked: dict[Axis, float]) -> dict[Axis, float]:
        """Return those of the rates, rad/s, whose axes do not turn yet; motion is stopped at its limit anyway."""
        return {axis: rate for axis, rate in asked.items() if not (self.rates and self.rates[axis])}

    def check_room(self, asked: dict[Axis, float], last: Reading | None) -> None:
        """Return if the axes have room to turn at these rates, rad/s, as far as is known. Raises LimitError."""
        if last is None:
            return
        for axis, rate in self.from_rest(asked).items():
            check_room(axis, self.description.axis(axis), last.axis(axis).angle_rad + rate * _AHEAD_S, rate)

    def begin(self, asked: dict[Axis, float], now_s: float) -> None:
        """Take new rates, rad/s."""
        self.rates, self.commanded_s = asked, now_s

    def stop(self, axis: Axis) -> None:
        """Note that one axis was stopped."""
        if self.rates is not None:
            self.rates[axis] = 0.0

    def end(self) -> None:
        """Forget the rates: another command replaced them, or they are to be halted."""
        self.rates = None

    def turns(self) -> bool:
        """Return whether an axis turns."""
        return self.rates is not None and any(self.rates.values())

    def is_overdue(self, now_s: float, watchdog_s: float) -> bool:
        """Return whether it continues though no command arrived for `watchdog_s`; 0 disables the watchdog."""
        return self.turns() and watchdog_s > 0 and now_s - self.commanded_s > watchdog_s

    def nears_limit(self, reading: Reading, now_s: float) -> bool:
        """Return whether an axis would pass its limit before the next check."""
        for axis, rate in (self.rates or {}).items():
            sample, reported = reading.axis(axis), self.description.axis(axis)
            ahead = sample.angle_rad + rate * (now_s - sample.t_s + _AHEAD_S)
            if (rate > 0 and ahead > reported.high_rad) or (rate < 0 and ahead < reported.low_rad):
                return True
        return False
