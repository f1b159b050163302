"""Can the axis be there? Between two readings it cannot turn faster, nor change its speed faster, than it can."""

import math
from dataclasses import dataclass
from enum import StrEnum


class AngleVerdict(StrEnum):
    """Results of the test of a new angle."""

    PLAUSIBLE = "plausible"
    CONFIRM = "confirm"
    """Possible, but not what was expected: to be asked once more."""
    IMPOSSIBLE = "impossible"


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """An angle at its instant: s, s, rad."""

    t_s: float
    sigma_t_s: float
    angle: float


class Plausibility:
    """The plausibility test of one axis; it changes nothing.

    Parameters
    ----------
    quantum, max_rate, max_acceleration : of the axis; rad, rad/s, rad/s² (or counts throughout).
    """

    def __init__(self, *, quantum: float, max_rate: float, max_acceleration: float) -> None:
        self._quantum = quantum
        self._rate = 1.1 * max_rate
        self._acceleration = 1.2 * max_acceleration if math.isfinite(max_acceleration) else 10.0 * max_rate
        self._last: Point | None = None
        self._slope = 0.0

    def forget(self) -> None:
        """Start without a previous angle: the next one has to be confirmed."""
        self._last = None
        self._slope = 0.0

    @property
    def has_past(self) -> bool:
        """Return whether an angle was accepted since `forget`."""
        return self._last is not None

    def judge(self, new: Point) -> AngleVerdict:
        """Return the result for a new angle."""
        last = self._last
        if last is None:
            return AngleVerdict.CONFIRM
        dt = max(0.0, new.t_s - last.t_s)
        jitter = 3.0 * math.hypot(new.sigma_t_s, last.sigma_t_s)
        off = abs(new.angle - last.angle)
        if off > self._rate * (dt + jitter) + 2.0 * self._quantum:
            return AngleVerdict.IMPOSSIBLE
        expected = last.angle + self._slope * dt
        near = abs(new.angle - expected) <= 2.5 * self._quantum + abs(self._slope) * jitter
        return AngleVerdict.PLAUSIBLE if near else AngleVerdict.CONFIRM

    def confirms(self, first: Point, second: Point) -> bool:
        """Return whether a second reading, right after, is consistent with the first and the earlier ones."""
        dt = second.t_s - first.t_s
        jitter = 3.0 * math.hypot(first.sigma_t_s, second.sigma_t_s)
        if self._last is None or first.t_s <= self._last.t_s:
            return abs(second.angle - first.angle) <= self._rate * (dt + jitter) + 2.0 * self._quantum
        before = first.t_s - self._last.t_s
        slope = (first.angle - self._last.angle) / before
        # the speed may have changed by acceleration · time: from the middle of one interval to that of the other
        room = self._acceleration * 0.5 * (before + dt) * dt
        room += (2.0 + dt / before) * self._quantum + max(abs(slope), abs(self._slope)) * jitter * (1.0 + dt / before)
        return abs(second.angle - (first.angle + slope * dt)) <= room

    def accept(self, new: Point) -> None:
        """Take an angle as the past of the next."""
        if self._last is not None and new.t_s > self._last.t_s:
            slope = (new.angle - self._last.angle) / (new.t_s - self._last.t_s)
            self._slope = max(-self._rate, min(self._rate, slope))
        self._last = new
