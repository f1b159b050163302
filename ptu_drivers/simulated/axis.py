"""One simulated axis: a motor that turns in trapezoids, a counter, and a head with play behind it."""

import bisect
import math
from dataclasses import dataclass

# before every command: finite, so that a speed of zero times it is zero
_EVER_S = -1e18


@dataclass(frozen=True, slots=True)
class _Piece:
    """Motion of constant acceleration from `t_s` on; the speed never changes its sign within a piece."""

    t_s: float
    position: float
    rate: float
    acceleration: float
    head: float

    def motor(self, t_s: float) -> float:
        d = t_s - self.t_s
        return self.position + self.rate * d + 0.5 * self.acceleration * d * d


class SimulatedAxis:
    """An axis in counts. Commands arrive in order of time; its state at any past time can be queried afterwards.

    Parameters
    ----------
    low, high : mechanical stops, counts.
    rate, max_rate : speed for moves at the start, and the fastest, counts/s.
    acceleration : counts/s².
    play : backlash, counts: the head follows the motor only after crossing it.
    """

    def __init__(
        self, *, low: int, high: int, rate: float, max_rate: float, acceleration: float, play: float = 0.0
    ) -> None:
        self.low, self.high = low, high
        self.rate, self.max_rate = rate, max_rate
        self.acceleration = acceleration
        self.play = play
        # counter = motor - origin: a power-cycle without homing moves the origin
        self.origin = 0.0
        self.target = 0.0
        self._pieces = [_Piece(_EVER_S, 0.0, 0.0, 0.0, 0.0)]
        self._starts = [_EVER_S]

    def motor(self, t_s: float) -> float:
        """Return the motor's position, counts."""
        return self._piece(t_s).motor(t_s)

    def speed(self, t_s: float) -> float:
        """Return the motor's speed, counts/s."""
        p = self._piece(t_s)
        return p.rate + p.acceleration * (t_s - p.t_s) if p.acceleration else p.rate

    def head(self, t_s: float) -> float:
        """Return where the head points, counts: the motor's position less the play it has not crossed."""
        p = self._piece(t_s)
        half, motor = self.play / 2, self.motor(t_s)
        return min(max(p.head, motor - half), motor + half)

    def counter(self, t_s: float) -> int:
        """Return the unit's own position, counts."""
        return round(self.motor(t_s) - self.origin)

    def end_s(self) -> float:
        """Return when the motion that is planned ends, s; infinite while a rate is held."""
        last = self._pieces[-1]
        return last.t_s if last.rate == 0.0 else math.inf

    def stops_at(self) -> float:
        """Return where the last planned motion ends, counts of the motor."""
        return self._pieces[-1].position

    def move_to(self, t_s: float, target: float, rate: float | None = None) -> None:
        """Turn to a position, counts of the counter."""
        self.target = target
        self._to(t_s, min(max(target + self.origin, self.low), self.high), abs(rate or self.rate))

    def move_at(self, t_s: float, rate: float) -> None:
        """Turn at a signed rate, counts/s, until a stop."""
        if rate == 0.0:
            self.halt(t_s)
        else:
            self._to(t_s, self.high if rate > 0 else self.low, abs(rate))

    def change_rate(self, t_s: float, rate: float) -> None:
        """Continue to the target at another speed, counts/s; no effect on an axis at rest."""
        if self.speed(t_s) != 0.0 and self.end_s() > t_s:
            self._to(t_s, self.stops_at(), abs(rate))

    def halt(self, t_s: float) -> None:
        """Brake, and stay."""
        self._cut(t_s)
        self._brake()
        self.target = self.stops_at() - self.origin

    def freeze(self, t_s: float) -> None:
        """Stand still at once: without power."""
        self._cut(t_s)
        last = self._pieces.pop()
        self._starts.pop()
        self._add(_Piece(t_s, last.position, 0.0, 0.0, last.head))

    def _to(self, t_s: float, target: float, rate: float) -> None:
        """Plan trapezoids from the state at `t_s` to rest at `target`."""
        self._cut(t_s)
        rate = min(rate, self.max_rate)
        last, a = self._pieces[-1], self.acceleration
        # the other way, or too late to brake: first to rest
        stop = last.position + last.rate * abs(last.rate) / (2 * a)
        way = math.copysign(1.0, target - last.position)
        if last.rate * way < 0 or (last.rate != 0 and (target - stop) * math.copysign(1.0, last.rate) < 0):
            self._brake()
            last = self._pieces[-1]
            way = math.copysign(1.0, target - last.position)
        elif abs(last.rate) > rate:
            self._for(-way * a, (abs(last.rate) - rate) / a)
            last = self._pieces[-1]
        distance, v0 = abs(target - last.position), abs(last.rate)
        peak = min(rate, math.sqrt(max(0.0, a * distance + v0 * v0 / 2)))
        cruise = distance - (2 * peak * peak - v0 * v0) / (2 * a)
        self._for(way * a, max(0.0, peak - v0) / a)
        if cruise > 0 and peak > 0:
            self._for(0.0, cruise / peak)
        self._for(-way * a, peak / a)
        self._rest(target)

    def _brake(self) -> None:
        rate = self._pieces[-1].rate
        self._for(-math.copysign(self.acceleration, rate), abs(rate) / self.acceleration)
        self._rest(self._pieces[-1].position)

    def _for(self, acceleration: float, duration_s: float) -> None:
        """Set the acceleration of the last piece, and begin the next one after so long."""
        if duration_s <= 0.0:
            return
        last = self._pieces.pop()
        self._starts.pop()
        piece = _Piece(last.t_s, last.position, last.rate, acceleration, last.head)
        self._add(piece)
        t_s = piece.t_s + duration_s
        self._add(_Piece(t_s, piece.motor(t_s), piece.rate + acceleration * duration_s, 0.0, self.head(t_s)))

    def _rest(self, position: float) -> None:
        last = self._pieces.pop()
        self._starts.pop()
        self._add(_Piece(last.t_s, position, 0.0, 0.0, last.head))

    def forget_before(self, t_s: float) -> None:
        """Discard the motion before `t_s`, which can no longer be queried."""
        old = max(0, bisect.bisect_right(self._starts, t_s) - 1)
        del self._pieces[:old], self._starts[:old]

    def _cut(self, t_s: float) -> None:
        """Discard the motion planned after `t_s`, and begin a segment there."""
        piece = _Piece(t_s, self.motor(t_s), self.speed(t_s), 0.0, self.head(t_s))
        keep = bisect.bisect_left(self._starts, t_s)
        del self._pieces[keep:], self._starts[keep:]
        self._add(piece)

    def _add(self, piece: _Piece) -> None:
        self._pieces.append(piece)
        self._starts.append(piece.t_s)

    def _piece(self, t_s: float) -> _Piece:
        return self._pieces[max(0, bisect.bisect_right(self._starts, t_s) - 1)]
