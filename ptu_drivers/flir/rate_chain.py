"""Motion by rate of a FLIR unit as a chain of moves to near targets, because it has no watchdog of its own.

In pure velocity control (`CV`) a unit whose host dies turns to its limit. In independent control the speed is the rate,
and the target is a lease ahead of the axis: with renewed targets the axis never comes near them and turns at its
rate as in velocity control; without, it brakes and stops. Speed and target may be changed in motion (PTU-D46
manual 4.3, 4.4.2). Only the speed sets the rate: an error of the assumed position makes the lease longer or
shorter.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from ptu_drivers.flir.probe import LETTER, UnitFacts
from ptu_drivers.flir.unit_conversion import Converter
from ptu_drivers.lease import LEASE_S, Lease, LeaseKind
from ptu_drivers.messages import Axis, Reading

# at rest so long after the last renewal, where braking leaves time for a lease, s
_REST_S = 1.0
# of that for commands under way, s
_UNDER_WAY_S = 0.1
# whatever braking takes, a lease outlasts the time in which a rate is repeated, s
_LEAST_S = 0.3
# a unit that accepts ten commands a second gets queries for both angles, often twice, and a speed and a target an axis:
# eight commands, and two more for other traffic
_CYCLE = 10
# a target is renewed when so much of its lease is gone: not with every command, for the line is slow
_GONE = 0.45
# and drawn back when it is further ahead than a whole lease by so much
_AHEAD = 0.1
# interval of two readings that gives the rate of an axis in a move to a position, s
_PAIR_S = 0.5
# a target is placed by a reading no older than that
_FRESH_S = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class _State:
    """An axis at an instant: s, counts, counts/s; it changes its rate to `goal` as fast as it can."""

    t_s: float
    position: float
    rate: float
    goal: float

    def after(self, t_s: float, acceleration: float) -> "_State":
        """Return the state at a later instant."""
        d = max(0.0, t_s - self.t_s)
        change = self.goal - self.rate
        ramp_s = abs(change) / acceleration
        if d < ramp_s:
            rate = self.rate + math.copysign(acceleration * d, change)
            position = self.position + 0.5 * (self.rate + rate) * d
        else:
            rate = self.goal
            position = self.position + 0.5 * (self.rate + rate) * ramp_s + rate * (d - ramp_s)
        return _State(t_s=max(t_s, self.t_s), position=position, rate=rate, goal=self.goal)


class LeasedAxis:
    """One axis: where it is thought to be, and the target that it needs.

    Parameters
    ----------
    converter : counts of angles, and the facts. axis : which.
    """

    def __init__(self, converter: Converter, axis: Axis) -> None:
        facts = converter.facts.axis(axis)
        self._convert, self._axis = converter, axis
        self._acceleration = facts.acceleration
        self._low, self._high = converter.bounds(axis)
        self._pace_s = converter.facts.pace_s
        self._state: _State | None = None
        self._target: int | None = None

    @property
    def goal(self) -> float:
        """Return the commanded rate, counts/s; 0 without one."""
        return self._state.goal if self._state else 0.0

    def observe(self, reading: Reading) -> None:
        """Take where it was."""
        sample = reading.axis(self._axis)
        position = self._convert.counts(self._axis, sample.angle_rad)
        old = self._state
        if old is None or sample.t_s <= old.t_s:
            self._state = _State(t_s=sample.t_s, position=position, rate=0.0, goal=0.0) if old is None else old
            return
        if self._target is not None:
            rate = self._at(old, sample.t_s).rate
        else:
            span_s = sample.t_s - old.t_s
            rate = (position - old.position) / span_s if span_s < _PAIR_S else 0.0
        self._state = _State(t_s=sample.t_s, position=position, rate=rate, goal=old.goal)

    def begin(self, goal: float, now_s: float) -> None:
        """Take a rate, counts/s; where it is must be known from a reading."""
        state = self._state
        if state is None:
            return
        if self._target is None:
            # it continues at the speed of its readings
            state = replace(state, goal=state.rate)
        self._state = replace(self._at(state, now_s), goal=goal)
        if goal * state.goal <= 0.0:
            # its target is in the other direction
            self._target = None

    def end(self) -> None:
        """It is halted, or moves to a position: only readings give its position."""
        self._target = None
        if self._state is not None:
            self._state = replace(self._state, goal=0.0)

    def forget(self) -> None:
        """Nothing is known of it any more."""
        self._state = self._target = None

    def due(self, now_s: float) -> int | None:
        """Return the target that it needs now, counts; None while the one it has will do."""
        state = self._state
        if state is None or state.goal == 0.0:
            return None
        lease_s, way = self.lease_s(abs(state.goal)), math.copysign(1.0, state.goal)
        now = self._at(state, now_s)
        # one step more, because angles are known to half a step: the target must not be behind
        ahead = math.ceil(way * self._rest_after(now, lease_s) + 1.0 - 1e-6)
        target = round(min(max(way * ahead, self._low), self._high))
        if self._target is not None:
            least = way * self._rest_after(now, (1.0 - _GONE) * lease_s)
            most = ahead + _AHEAD * lease_s * abs(state.goal) + 2.0
            if target == self._target or least <= way * self._target <= most:
                return None
        return target

    def _rest_after(self, now: _State, duration_s: float) -> float:
        """Return where it comes to rest after moving for this time and braking, counts."""
        then = now.after(now.t_s + duration_s, self._acceleration)
        return then.position + then.rate * abs(then.rate) / (2.0 * self._acceleration)

    def _at(self, state: _State, t_s: float) -> _State:
        """Return the state at a later instant; an axis whose target was not renewed stands still."""
        then = state.after(t_s, self._acceleration)
        if self._target is not None and (then.position - self._target) * state.goal > 0.0:
            return replace(then, position=float(self._target), rate=0.0)
        return then

    def sent(self, target: int) -> None:
        """Note that it has this target."""
        self._target = target

    def lease_s(self, rate: float) -> float:
        """Return the time for which it holds a rate, counts/s, after a renewal, s, without the braking."""
        return lease_s(rate / self._acceleration, self._pace_s)


def lease_s(braking_s: float, pace_s: float) -> float:
    """Return how long a rate is held after a renewal where braking takes so long, s, and a command `pace_s`."""
    return max(_LEAST_S, _CYCLE * pace_s, min(LEASE_S, _REST_S - _UNDER_WAY_S - braking_s))


def lease_of(facts: UnitFacts) -> Lease:
    """Return the lease of a unit; it takes longest to rest from its fastest rate."""
    braking_s = [facts.axis(axis).max_rate / facts.axis(axis).acceleration for axis in Axis]
    return Lease(
        kind=LeaseKind.SHORT_MOVES,
        renewed_s=lease_s(0.0, facts.pace_s),
        stop_s=max(lease_s(b, facts.pace_s) + b for b in braking_s) + _UNDER_WAY_S,
    )


class RateChain:
    """Both axes' speeds and targets in the unit, and the commands that change them.

    Parameters
    ----------
    converter : counts of angles, and the facts.
    command : executes one command; its exceptions are passed on.
    now : the clock, s.
    """

    def __init__(self, converter: Converter, command: Callable[[str], None], now: Callable[[], float]) -> None:
        self._command, self._now = command, now
        self._axes = {axis: LeasedAxis(converter, axis) for axis in Axis}
        self._speeds = {axis: converter.facts.axis(axis).rate for axis in Axis}
        self._halted: set[Axis] = set()
        self._seen_s = -math.inf

    def is_lost(self) -> bool:
        """Return whether the last angles are too old to place a target by, or of before a halt."""
        return self._now() - self._seen_s > _FRESH_S

    def observe(self, reading: Reading) -> None:
        """Take where the axes were."""
        self._seen_s = max(reading.pan.t_s, reading.tilt.t_s)
        for axis in self._axes.values():
            axis.observe(reading)

    def turn(self, rates: dict[Axis, int]) -> None:
        """Turn at signed rates, counts/s; 0 halts an axis, which is sent first. All speeds precede all targets."""
        for axis in (axis for axis, rate in rates.items() if rate == 0):
            self.halt(axis)
        for axis in (axis for axis, rate in rates.items() if rate):
            self.set_speed(axis, abs(rates[axis]))
        for axis, rate in rates.items():
            if rate:
                self._axes[axis].begin(rate, self._now())
        self.renew()

    def renew(self) -> None:
        """Put targets further ahead, or nearer, where it is time."""
        for name, axis in self._axes.items():
            target = axis.due(self._now())
            if target is not None:
                self._halted.discard(name)
                self._command(f"{LETTER[name]}P{target}")
                axis.sent(target)

    def halt(self, axis: Axis) -> None:
        """Halt one axis, unless it was halted and not moved since."""
        if axis not in self._halted:
            self._command(f"H{LETTER[axis]}")
            self._halted.add(axis)
        self._axes[axis].end()

    def set_speed(self, axis: Axis, speed: int) -> None:
        """Set a speed, counts/s, unless the unit has it."""
        if self._speeds.pop(axis, None) != speed:
            self._command(f"{LETTER[axis]}S{speed}")
        self._speeds[axis] = speed

    def go(self, targets: dict[Axis, int]) -> None:
        """Send axes to positions, counts; their rates end, and the others'."""
        for axis in Axis:
            if axis not in targets and self._axes[axis].goal:
                self.halt(axis)
            self._axes[axis].end()
        for axis, target in targets.items():
            self._halted.discard(axis)
            self._command(f"{LETTER[axis]}P{target}")

    def stand(self, speeds: dict[Axis, int] | None = None) -> None:
        """Both axes were halted; or the unit was restarted, with these speeds."""
        self._halted, self._seen_s = set(Axis), -math.inf
        for axis in self._axes.values():
            axis.forget()
        if speeds is not None:
            self._speeds = dict(speeds)
