"""Whether a halted unit stands, by its readings."""

import math

from ptu_drivers.messages import Reading

# slower than any commanded rate, and a quantum of a coarse encoder between two readings
_STANDS_RAD_S = math.radians(0.5)
_LEAST_APART_S = 0.02
# the longest that a unit brakes; one that gives no angles is not waited for any longer
_MOST_S = 2.0


class StandingCheck:
    """Waits from a halt until two readings in succession show no motion, for two seconds at most."""

    def __init__(self) -> None:
        self._began_s = -math.inf
        self._last: Reading | None = None
        self._stands = True

    def begin(self, now_s: float) -> None:
        """Wait from now on."""
        self._began_s, self._last, self._stands = now_s, None, False

    def is_awaited(self, now_s: float) -> bool:
        """Return whether the unit may still turn."""
        return not self._stands and now_s - self._began_s < _MOST_S

    def take(self, reading: Reading) -> None:
        """Compare a reading with the one before it."""
        last = self._last
        if last is None:
            self._last = reading
            return
        apart_s = min(reading.pan.t_s - last.pan.t_s, reading.tilt.t_s - last.tilt.t_s)
        if apart_s < _LEAST_APART_S:
            return
        moved = max(abs(reading.pan.angle_rad - last.pan.angle_rad), abs(reading.tilt.angle_rad - last.tilt.angle_rad))
        self._last = reading
        self._stands = self._stands or moved < _STANDS_RAD_S * apart_s
