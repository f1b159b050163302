"""Delay of the radio link by TIMESYNC: half of the median round trip, or of the shortest."""

from collections import deque

import numpy as np

# a link's delay is judged from the last half minute, at one request a second
_KEPT = 30
_LEAST = 3
# an answer that took longer belongs to no request that matters
_LONGEST_S = 2.0


class RoundTripDelay:
    """One-way delay of the link: half of the median, or of the least, of the last round trips."""

    def __init__(self) -> None:
        self._trips_s: deque[float] = deque(maxlen=_KEPT)

    def answered(self, sent_s: float, received_s: float) -> None:
        """Note that a request sent at ``sent_s`` was answered; both session time."""
        if 0.0 <= received_s - sent_s <= _LONGEST_S:
            self._trips_s.append(received_s - sent_s)

    @property
    def one_way_s(self) -> float | None:
        """Half of the median round trip; None before three answers."""
        if len(self._trips_s) < _LEAST:
            return None
        return 0.5 * float(np.median(self._trips_s))

    @property
    def least_one_way_s(self) -> float | None:
        """Half of the shortest round trip; None before three answers."""
        return None if len(self._trips_s) < _LEAST else 0.5 * min(self._trips_s)
