"""Whether an axis can have turned from its last angle to this one: no filter, an angle passes unchanged or not at all."""

import math
from dataclasses import dataclass

from ptu_drivers.health import DoubtReason
from ptu_drivers.polled_unit import Doubtful


@dataclass(frozen=True, slots=True)
class _Seen:
    t_s: float
    sigma_t_s: float
    angle_rad: float


@dataclass(slots=True, kw_only=True)
class Plausibility:
    """Remembers one axis' last angle.

    An angle that is out of reach, or the first one after a long silence, is held back; it stands when the next one is
    within reach of it. So a lone wrong angle never passes, and a true jump (a unit that was carried) costs one reading.

    Attributes
    ----------
    max_rate_rad_s : fastest that the axis can turn, rad/s.
    quantum_rad : step of its angles, rad.
    turn_rad : a whole turn where the angle wraps, 0 where it does not.
    memory_s : how long an angle vouches for the next one, s.
    """

    max_rate_rad_s: float
    quantum_rad: float
    turn_rad: float = 0.0
    memory_s: float = 2.0
    _last: _Seen | None = None
    _held: _Seen | None = None

    def check(self, t_s: float, sigma_t_s: float, angle_rad: float) -> None:
        """Return if the angle can be believed. Raises Doubtful."""
        new = _Seen(t_s, sigma_t_s, angle_rad)
        if self._vouches(self._last, new) or self._vouches(self._held, new):
            self._last, self._held = new, None
            return
        self._held = new
        raise Doubtful(DoubtReason.TOO_FAST, f"{math.degrees(angle_rad):.2f} deg, which nothing vouches for")

    def forget(self) -> None:
        """Let no earlier angle vouch."""
        self._last = self._held = None

    def _vouches(self, old: _Seen | None, new: _Seen) -> bool:
        if old is None or new.t_s - old.t_s > self.memory_s:
            return False
        turned_rad = abs(new.angle_rad - old.angle_rad)
        if self.turn_rad:
            turned_rad = min(turned_rad, abs(self.turn_rad - turned_rad))
        room_s = abs(new.t_s - old.t_s) + 3 * (old.sigma_t_s + new.sigma_t_s)
        return turned_rad <= self.max_rate_rad_s * room_s + 2 * self.quantum_rad
