"""Delay of the radio link by TIMESYNC: half of the median round trip, or of the shortest, and how it varies."""

from collections import deque

import numpy as np

# a link's delay is judged from the last half minute, at one request a second
_KEPT = 30
_LEAST = 3
# an answer that took longer belongs to no request that matters
_LONGEST_S = 2.0
# one sigma of the one-way delay before anything is known of it, as of a telemetry radio that sends in turns of some ten
# ms, and how many round trips that knowledge is worth
_PRIOR_SIGMA_S, _PRIOR_TRIPS = 0.02, 2.0


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

    @property
    def one_way_sigma_s(self) -> float:
        """One sigma of a message's delay about the link's.

        Both ways of a round trip vary by themselves, so its variance is twice that of one way. Before there are many
        trips it is drawn towards 20 ms.
        """
        trips = np.array(self._trips_s)
        scatter_s2 = 0.5 * float(np.sum((trips - trips.mean()) ** 2)) if len(trips) else 0.0
        freedom = _PRIOR_TRIPS + max(len(trips) - 1, 0)
        return float(np.sqrt((_PRIOR_TRIPS * _PRIOR_SIGMA_S**2 + scatter_s2) / freedom))
