"""Delay of the radio link to a vehicle by TIMESYNC: of the fastest message, the median, and how it varies.

An answer holds the vehicle's clock when the request arrived there. So each way is observed apart from the other, but
for the offset between the clocks, which is such that the fastest request and the fastest answer took equally long.
"""

import math
from collections import deque

import numpy as np

# a link's delay is judged from the last half minute, at five requests a second
_KEPT = 150
_LEAST = 3
# an answer that took longer belongs to no request that matters
_LONGEST_S = 2.0
# one sigma of the one-way delay before anything is known of it, as of a telemetry radio that sends in turns of some ten
# ms, and how many answers that knowledge is worth
_PRIOR_SIGMA_S, _PRIOR_TRIPS = 0.02, 2.0
# a request that arrives so long before it was sent: the vehicle's clock was set, or is none
_CLOCK_SET_S = -0.02
# the fastest request and the fastest answer differ by a tenth of their delay, one sigma: not observable, an estimate
_UNEQUAL = 0.1


class LinkDelay:
    """Delay to the vehicle, one way, of the last requests that were answered."""

    def __init__(self) -> None:
        # each with an unknown offset of the vehicle's clock, plus and minus
        self._there_s: deque[float] = deque(maxlen=_KEPT)
        self._back_s: deque[float] = deque(maxlen=_KEPT)

    def answered(self, sent_s: float, vehicle_s: float, received_s: float) -> None:
        """Note that a request was answered; session time, ``vehicle_s`` the vehicle's clock when it got it."""
        if not (0.0 <= received_s - sent_s <= _LONGEST_S and math.isfinite(vehicle_s)):
            return
        self._there_s.append(vehicle_s - sent_s)
        self._back_s.append(received_s - vehicle_s)
        if min(self._there_s) + min(self._back_s) < _CLOCK_SET_S:
            for kept in (self._there_s, self._back_s):
                newest = kept.pop()
                kept.clear()
                kept.append(newest)

    @property
    def least_one_way_s(self) -> float | None:
        """Delay of the fastest message; None before three answers."""
        return None if len(self._there_s) < _LEAST else self._least()

    @property
    def one_way_s(self) -> float | None:
        """Median delay; None before three answers."""
        if len(self._there_s) < _LEAST:
            return None
        return float(np.median(self._there_s)) - min(self._there_s) + self._least()

    @property
    def answers(self) -> int:
        """How many are kept."""
        return len(self._there_s)

    @property
    def least_round_trip_s(self) -> float | None:
        """Shortest time from a request to its answer; None before the first."""
        return min((there + back for there, back in zip(self._there_s, self._back_s, strict=True)), default=None)

    @property
    def one_way_sigma_s(self) -> float:
        """One sigma of a message's delay about the link's; before there are many answers it is drawn towards 20 ms."""
        there = np.array(self._there_s)
        scatter_s2 = float(np.sum((there - there.mean()) ** 2)) if len(there) else 0.0
        freedom = _PRIOR_TRIPS + max(len(there) - 1, 0)
        return float(np.sqrt((_PRIOR_TRIPS * _PRIOR_SIGMA_S**2 + scatter_s2) / freedom))

    @property
    def least_sigma_s(self) -> float:
        """One sigma of the delay of the message that the vehicle takes for the fastest.

        It judges by other messages than these, and by its last hundred: their fastest is taken to be off by what the
        third fastest here is slower than the fastest. And the two ways need not be equally fast.
        """
        if len(self._there_s) < _LEAST:
            return self.one_way_sigma_s
        fastest_s, _, third_s = sorted(self._there_s)[:_LEAST]
        return math.hypot(third_s - fastest_s, _UNEQUAL * self._least())

    def beyond_sigma_s(self, allowed_s: float) -> float:
        """Return the rms of that by which a message is later than the fastest by more than is allowed."""
        if not self._there_s:
            return 0.0
        late = np.array(self._there_s) - min(self._there_s)
        return float(np.sqrt(np.mean(np.maximum(late - allowed_s, 0.0) ** 2)))

    def _least(self) -> float:
        return max(0.5 * (min(self._there_s) + min(self._back_s)), 0.0)
