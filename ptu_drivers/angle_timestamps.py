"""Time stamps of angles: bounds from the line, and the relation of the unit's own clock to the host's."""

import math
from collections import deque
from dataclasses import dataclass

from ptu_drivers.clock_offset import OffsetBounds, intersection
from ptu_drivers.messages import AngleSource

_SQRT12 = math.sqrt(12.0)
# lower limit: neither the host's clock nor a unit's reading of its counters is more accurate
_LEAST_SIGMA_S = 1e-4
_DRIFT = 200e-6
_KEPT = 64
_COUNTER = 2**32


@dataclass(frozen=True, slots=True, kw_only=True)
class Instant:
    """An instant with its 1 sigma, s, and where it is from."""

    t_s: float
    sigma_s: float
    source: AngleSource


@dataclass(frozen=True, slots=True, kw_only=True)
class Latency:
    """Delays of a unit and its line, s.

    Attributes
    ----------
    unit_s, unit_sigma_s : from the delimiter to the reply's first bit, and its spread.
    send_sigma_s : spread of the delay between a write and the line, also its mean; infinite over a network.
    """

    unit_s: float
    unit_sigma_s: float
    send_sigma_s: float


def query_instant(
    *, earliest_s: float, sent_s: float, latest_s: float, first_bit_s: float, latency: Latency
) -> Instant:
    """Return when a query's delimiter reached the unit, which then reads its counters.

    On a serial port it is the end of the last byte on the line. Over a network it is the first bit of the reply less
    the unit's latency, or, for a reply later than that explains, the middle of the bounds. It is never outside
    the bounds, and its sigma is at most their width.

    Parameters
    ----------
    earliest_s, latest_s : bounds, s (`Exchanged`).
    sent_s : end of the last byte on the line if the port sent it at once, s.
    first_bit_s : arrival of the first bit of the reply, s.
    """
    width = latest_s - earliest_s
    if math.isfinite(latency.send_sigma_s):
        sigma = math.hypot(latency.send_sigma_s, (sent_s - earliest_s) / _SQRT12)
        # a port may send later than requested, never earlier; no later than the middle of the bounds is likely
        at = max(earliest_s, min(sent_s + latency.send_sigma_s, 0.5 * (earliest_s + latest_s)))
        source = AngleSource.LAST_BYTE_SENT
        return Instant(t_s=at, sigma_s=_at_least(min(sigma, width / _SQRT12)), source=source)
    guess = first_bit_s - latency.unit_s
    if earliest_s <= guess <= latest_s and width <= latency.unit_s + 3.0 * latency.unit_sigma_s:
        sigma = _at_least(min(latency.unit_sigma_s, width / _SQRT12))
        return Instant(t_s=guess, sigma_s=sigma, source=AngleSource.FIRST_REPLY_BYTE)
    middle = 0.5 * (earliest_s + latest_s)
    return Instant(t_s=middle, sigma_s=_at_least(width / _SQRT12), source=AngleSource.ROUND_TRIP)


def _at_least(sigma_s: float) -> float:
    return max(sigma_s, _LEAST_SIGMA_S)


class DeviceClock:
    """A unit's counter related to the host's clock: each exchange bounds the offset, the bounds intersect.

    Parameters
    ----------
    frequency_hz : the counter's frequency as reported by the unit.
    """

    def __init__(self, frequency_hz: float) -> None:
        self.frequency_hz = frequency_hz
        self._bounds: deque[OffsetBounds] = deque(maxlen=_KEPT)
        self._last = -1
        self._turns = 0

    def ran_backwards(self, count: int) -> bool:
        """Return whether a count is below the last one, and not because the counter turned over."""
        return 0 <= self._last - count <= _COUNTER // 2 and count != self._last

    def instant(self, count: int, earliest_s: float, latest_s: float) -> Instant:
        """Return the instant of a count that was read between the bounds, s in the host's clock."""
        if count < self._last:
            if self.ran_backwards(count):
                self._bounds.clear()
            else:
                self._turns += 1
        self._last = count
        device = (count + self._turns * _COUNTER) / self.frequency_hz
        new = OffsetBounds(device, earliest_s - device, latest_s - device)
        self._bounds.append(new)
        offset = intersection(self._bounds, device, _DRIFT)
        if offset is None:
            # a clock that jumped, or a wrong nominal frequency: restart with this exchange
            self._bounds.clear()
            self._bounds.append(new)
            offset = new
        return Instant(
            t_s=device + offset.middle_s,
            sigma_s=_at_least(offset.width_s / _SQRT12),
            source=AngleSource.DEVICE_CLOCK,
        )
