"""The clock of a device related to the host's: each reply bounds a device time by two instants of the host."""

import math
from dataclasses import dataclass

from ptu_drivers.clock_offset import OffsetBounds, intersection
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason


@dataclass(slots=True, kw_only=True)
class TickClock:
    """A counter that ticks in a device.

    The differences that a reply allows are an interval, whose width is the time that the device had to reply; the
    intersection of all of them, widened by the drift in between, is narrower than any. A reply to an older query
    has an older tick than possible, and is refused; so is the first reply after the device was restarted, until the
    next one agrees with it.

    Attributes
    ----------
    tick_s : seconds per tick.
    ticks : the count at which it wraps to 0.
    drift : largest relative drift of the clocks, s/s.
    """

    tick_s: float
    ticks: int
    drift: float = 5e-4
    _tie: OffsetBounds | None = None
    _held: OffsetBounds | None = None

    def instant(self, tick: int, earliest_s: float, latest_s: float) -> tuple[float, float]:
        """Return the time of the tick, and 1 sigma, s.

        Parameters
        ----------
        tick : the counter's value. earliest_s, latest_s : bounds in the host's clock.

        Raises
        ------
        ExchangeFailed : the value is impossible within these bounds.
        """
        for tie, reason in ((self._tie, None), (self._held, FailureReason.STARTING)):
            if tie is None:
                continue
            new = self._joined(tie, tick, earliest_s, latest_s)
            if new is not None:
                self.restarted = reason is not None
                self._tie, self._held = new, None
                shown_s = self._device_s(tick, latest_s - new.middle_s)
                t_s = min(max(shown_s + 0.5 * self.tick_s + new.middle_s, earliest_s), latest_s)
                return t_s, math.hypot(self.tick_s, new.width_s) / math.sqrt(12)
        device_s = tick * self.tick_s
        self._held = self._bounds(device_s, earliest_s, latest_s)
        if self._tie is None:
            raise ExchangeFailed(FailureReason.STARTING, "the first tick")
        raise ExchangeFailed(FailureReason.ECHO_MISMATCH, f"tick {tick}, which it cannot show now")

    restarted: bool = False
    """The last answer was the second of a new count: the device was restarted, or seen for the first time."""

    def _device_s(self, tick: int, near_s: float) -> float:
        """Return the device's time of a tick, of all with that count the nearest."""
        turn_s = self.ticks * self.tick_s
        return tick * self.tick_s + round((near_s - tick * self.tick_s) / turn_s) * turn_s

    def _joined(self, tie: OffsetBounds, tick: int, earliest_s: float, latest_s: float) -> OffsetBounds | None:
        new = self._bounds(self._device_s(tick, latest_s - tie.middle_s), earliest_s, latest_s)
        return intersection((tie, new), latest_s, self.drift)

    def _bounds(self, device_s: float, earliest_s: float, latest_s: float) -> OffsetBounds:
        return OffsetBounds(latest_s, earliest_s - device_s - self.tick_s, latest_s - device_s)
