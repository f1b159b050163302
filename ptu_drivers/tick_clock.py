"""The clock of a device tied to ours: each answer says what its clock showed between two instants of ours."""

import math
from dataclasses import dataclass

from ptu_drivers.clock_offset import OffsetBounds, intersection
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason


@dataclass(slots=True, kw_only=True)
class TickClock:
    """A counter that ticks in a device.

    The differences that an answer allows are an interval, whose width is the time that the device had to answer; the
    intersection of all of them, widened by the drift in between, is narrower than any. An answer to an older question
    shows an older tick than it can, and is refused; so is the first answer after the device was restarted, until the
    next one agrees with it.

    Attributes
    ----------
    tick_s : seconds per tick.
    ticks : at this count it begins again from 0.
    drift : most that the clocks run apart, s/s.
    """

    tick_s: float
    ticks: int
    drift: float = 5e-4
    _tie: OffsetBounds | None = None
    _held: OffsetBounds | None = None

    def instant(self, tick: int, earliest_s: float, latest_s: float) -> tuple[float, float]:
        """Return when the tick was shown, and 1 sigma, s.

        Parameters
        ----------
        tick : what the counter showed. earliest_s, latest_s : between these instants of ours.

        Raises
        ------
        ExchangeFailed : it cannot have shown that then.
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
