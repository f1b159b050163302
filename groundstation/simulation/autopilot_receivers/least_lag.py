"""ArduPilot's correction of stamps: the sender's clock by the message that was least late."""

import math

_WINDOW = 100


class LeastLagClock:
    """Turns the sender's stamps into the vehicle's time.

    A message cannot come from the future: the least difference between arrival and stamp is taken for the difference
    of the clocks. So each message is attributed as if its link were as fast as the fastest message's. It is judged
    again after each hundred messages; no stamp is taken to be older than ``most_lag_s``.
    """

    def __init__(self, most_lag_s: float) -> None:
        self._most_lag_s = most_lag_s
        self._offset_s = math.inf
        self._least_s = math.inf
        self._seen = 0

    def local_s(self, stamp_s: float, now_s: float) -> float:
        """Return the vehicle's time of a stamp that arrives at ``now_s``."""
        difference_s = now_s - stamp_s
        self._offset_s = min(self._offset_s, difference_s)
        local_s = stamp_s + self._offset_s
        if local_s < now_s - self._most_lag_s:
            local_s = now_s - self._most_lag_s
            self._offset_s = local_s - stamp_s
        self._least_s = min(self._least_s, difference_s)
        self._seen += 1
        if self._seen == _WINDOW:
            self._offset_s, self._least_s, self._seen = self._least_s, math.inf, 0
        return local_s
