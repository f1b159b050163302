"""Pointing of a station's PTU: the angles at the time a command takes effect, and the rates.

A command issued now moves the head ``latency_s`` later. The target is therefore predicted to that time, and the head by
the rates commanded since its newest reading; the rate is the target's own (feed-forward) plus a share of the predicted
error. It is limited to the PTU's rate, acceleration and limits here, because a driver refuses and does not clip.
The two axes are independent.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice, takewhile

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.geometry.aim import Aim, aim_at
from groundstation.geometry.angles import wrap_rad
from groundstation.geometry.station import StationGeometry
from groundstation.messages import PointingCommand, PtuSample, Purpose
from groundstation.pointing.head_limits import AxisLimits, HeadLimits
from groundstation.pointing.keep_out import KeepOut
from groundstation.pointing.keep_out_pointing import KeepOutController
from groundstation.rig.ptu_axes import IDEAL_AXES, Backlash, PtuAxes

_GAIN_TIMES_LATENCY = 0.3
# a driver refuses a rate from which the axis could not stop before its limit if the stop command came so late
_STOPS_AFTER_S = 0.1
# a head that is held before a closed zone creeps no slower than that: the Sun moves at 0.004 °/s
_STANDS_RAD_S = math.radians(0.1)


@dataclass(frozen=True, slots=True, kw_only=True)
class PointingConfig:
    """Tuning of the pointing law.

    Attributes
    ----------
    gain_per_s : share of an angular error that is corrected in a second.
    rate_share, acceleration_share : share of the PTU's maximum rate and acceleration that is used.
    margin_deg : distance from its limits at which an axis is stopped.
    rate_step_s : interval of the difference that gives the target's angular rate.
    stale_s : age of the newest reading beyond which the head is not turned.
    latency_s : from an acknowledged command to the head's motion; the line's delay is measured.
    """

    gain_per_s: float = 4.0
    rate_share: float = 0.9
    acceleration_share: float = 0.8
    margin_deg: float = 0.5
    rate_step_s: float = 0.05
    stale_s: float = 0.5
    latency_s: float = 0.02

    def __post_init__(self) -> None:
        if self.gain_per_s <= 0 or self.rate_step_s <= 0 or self.stale_s <= 0 or self.latency_s < 0:
            raise ValueError("gain_per_s, rate_step_s and stale_s must be > 0, latency_s ≥ 0")
        if not (0 < self.rate_share <= 1 and 0 < self.acceleration_share <= 1 and self.margin_deg >= 0):
            raise ValueError("rate_share and acceleration_share must be in (0, 1], margin_deg ≥ 0")


class AxisController:
    """One axis: where it will be, and the rate that brings it where it should be."""

    def __init__(self, limits: AxisLimits, config: PointingConfig) -> None:
        self._limits = limits
        self._config = config
        self._commands: deque[tuple[float, float]] = deque([(-math.inf, 0.0)])
        self._reading: tuple[float, float] | None = None

    def read(self, t_s: float, angle_rad: float) -> None:
        """Take a reading: the angle at a time."""
        if self._reading is None or t_s > self._reading[0]:
            self._reading = (t_s, angle_rad)

    @property
    def newest_rad(self) -> float:
        """The angle of the newest reading; NaN without one."""
        return math.nan if self._reading is None else self._reading[1]

    def age_s(self, now_s: float) -> float:
        """Return how old the newest reading is."""
        return math.inf if self._reading is None else now_s - self._reading[0]

    def expected(self, t_s: float, latency_s: float) -> float | None:
        """Return the angle at ``t_s``, from the newest reading and the commanded rates; None without a reading."""
        if self._reading is None:
            return None
        read_s, angle = self._reading
        # the rate at the reading's own time and the later ones; a replaced rate adds nothing
        since = sum(1 for _ in takewhile(lambda command: command[0] + latency_s > read_s, reversed(self._commands)))
        held = list(islice(self._commands, max(len(self._commands) - 1 - since, 0), None))
        ends = [*(at + latency_s for at, _ in held[1:]), t_s]
        for (at, rate), end in zip(held, ends, strict=True):
            angle += rate * max(min(end, t_s) - max(at + latency_s, read_s), 0.0)
        return angle

    def rate_to(self, now_s: float, wanted_rad: float, wanted_rate_rad_s: float, latency_s: float) -> float:
        """Return the rate to command now to put the axis at ``wanted_rad``, with its rate, ``latency_s`` from now."""
        angle = self.expected(now_s + latency_s, latency_s)
        if angle is None or self.age_s(now_s) > self._config.stale_s:
            return self._command_rate(now_s, 0.0)
        limits, config = self._limits, self._config
        # as the head counts: not through its back
        off = wanted_rad - angle
        brakes = config.acceleration_share * limits.acceleration_rad_s2
        # a command rate faster than its effect overshoots
        gain = min(config.gain_per_s, _GAIN_TIMES_LATENCY / latency_s) if latency_s > 0 else config.gain_per_s
        back = min(gain * abs(off), math.sqrt(2.0 * brakes * abs(off)) if off else 0.0)
        rate = wanted_rate_rad_s + math.copysign(back, off)
        fastest = config.rate_share * limits.fastest_rad_s
        rate = min(max(rate, -fastest), fastest)
        last_s, last = self._commands[-1]
        if math.isfinite(brakes):
            step = brakes * min(max(now_s - last_s, 0.0), config.stale_s) if math.isfinite(last_s) else 0.0
            rate = min(max(rate, last - step), last + step)
        return self._command_rate(now_s, self._kept_inside(angle, rate, brakes))

    def replace_rate(self, rate_rad_s: float, now_s: float, latency_s: float) -> float:
        """Replace the last commanded rate by another, within the axis's limits; returns that."""
        angle = self.expected(now_s + latency_s, latency_s)
        fastest = self._config.rate_share * self._limits.fastest_rad_s
        brakes = self._config.acceleration_share * self._limits.acceleration_rad_s2
        rate = min(max(rate_rad_s, -fastest), fastest)
        rate = 0.0 if angle is None else self._kept_inside(angle, rate, brakes)
        self._commands[-1] = (self._commands[-1][0], rate)
        return rate

    def clipped(self, angle_rad: float) -> float:
        """Return an angle within the range that may be commanded."""
        margin = math.radians(self._config.margin_deg)
        return min(max(angle_rad, self._limits.low_rad + margin), self._limits.high_rad - margin)

    def nearest_turn(self, angle_rad: float) -> float:
        """Return an angle with the whole turns that the axis can reach, the nearest to where it is.

        The zero of a unit's readings may be anywhere, and its range more or less than a turn.
        """
        turns = [angle_rad + k * math.tau for k in (-2, -1, 0, 1, 2)]
        inside = [turn for turn in turns if self._limits.low_rad <= turn <= self._limits.high_rad]
        here = 0.0 if self._reading is None else self._reading[1]
        return min(inside, key=lambda turn: abs(turn - here)) if inside else wrap_rad(angle_rad)

    def stopped(self, now_s: float) -> None:
        """Note that the axis was halted."""
        self._command_rate(now_s, 0.0)

    def _kept_inside(self, angle_rad: float, rate: float, brakes: float) -> float:
        """Return a rate from which the axis can still stop before its limit, and that it can turn at."""
        margin = math.radians(self._config.margin_deg)
        room = (self._limits.high_rad - margin - angle_rad) if rate > 0 else (angle_rad - self._limits.low_rad - margin)
        if math.isfinite(room):
            rate = math.copysign(min(abs(rate), _fastest_within(room, brakes)), rate) if room > 0 else 0.0
        slowest = self._limits.slowest_rad_s
        if abs(rate) < slowest:
            rate = math.copysign(slowest, rate) if abs(rate) > 0.5 * slowest else 0.0
        return rate

    def _command_rate(self, now_s: float, rate: float) -> float:
        self._commands.append((now_s, rate))
        # rates before the newest reading are included in it
        oldest_s = now_s - 10.0 * self._config.stale_s
        while len(self._commands) > 2 and self._commands[1][0] < oldest_s:
            self._commands.popleft()
        return rate


def _fastest_within(room_rad: float, brakes_rad_s2: float) -> float:
    """Return the rate v whose way to rest, v ``_STOPS_AFTER_S`` + v² / (2 brakes), is all of the room."""
    if math.isinf(brakes_rad_s2):
        return room_rad / _STOPS_AFTER_S
    late = brakes_rad_s2 * _STOPS_AFTER_S
    return math.sqrt(late * late + 2.0 * brakes_rad_s2 * room_rad) - late


class HeadController:
    """Controls one station's PTU: follows a target, moves to angles, holds; around its lens's keep-out zones, if any.

    Limits, zones, readings and commands are of the unit's own readings, of which ``axes`` makes pan and tilt;
    ``keep_out`` is at session times.
    """

    def __init__(
        self,
        geometry: StationGeometry,
        limits: HeadLimits,
        config: PointingConfig,
        keep_out: KeepOut | None = None,
        axes: PtuAxes = IDEAL_AXES,
    ) -> None:
        self.geometry = geometry
        self.keep_out = (
            None if keep_out is None or keep_out.is_empty else _keep_out_controller(keep_out, limits, config)
        )
        self.latency_s = config.latency_s
        self._config = config
        self._pan, self._tilt = AxisController(limits.pan, config), AxisController(limits.tilt, config)
        self._axes = None if axes.is_ideal_apart_from_lean else axes
        self._backlash = Backlash(axes.pan_backlash_rad), Backlash(axes.tilt_backlash_rad)
        self._senses = (0.0, 0.0)

    def read(self, sample: PtuSample) -> None:
        """Take a reading of this station's PTU, as the unit gives it, at its session time."""
        pan, tilt = self._backlash
        self._senses = pan.sense(sample.pan_rad), tilt.sense(sample.tilt_rad)
        self._pan.read(sample.t_s, sample.pan_rad)
        self._tilt.read(sample.t_s, sample.tilt_rad)

    def age_s(self, now_s: float) -> float:
        """Return how old the newest reading is."""
        return self._pan.age_s(now_s)

    def may_look_at(self, now_s: float, point_runway_m: FloatArray) -> bool:
        """Return whether the lens is not kept from a point (3,), runway frame."""
        if self.keep_out is None or self.keep_out.zones(now_s).is_empty:
            return True
        aim = self._reading_at(point_runway_m)
        return aim is None or self.keep_out.allows(now_s, (aim.pan_rad, aim.tilt_rad))

    def follow(
        self, now_s: float, target: Callable[[float], FloatArray | None], purpose: Purpose = Purpose.TRACK
    ) -> PointingCommand:
        """Return the command that keeps a moving point at the principal point.

        ``target`` returns the point (3,) at a session time, runway frame; where it returns none, or one outside the
        station's range, the head is held still.
        """
        act_s = now_s + self.latency_s
        here, there = target(act_s), target(act_s + self._config.rate_step_s)
        aim = None if here is None else self._reading_at(here)
        later = None if there is None else self._reading_at(there)
        if aim is None or later is None:
            return self.hold(now_s)
        step = self._config.rate_step_s
        rates = (wrap_rad(later.pan_rad - aim.pan_rad) / step, wrap_rad(later.tilt_rad - aim.tilt_rad) / step)
        return self._command(now_s, (aim.pan_rad, aim.tilt_rad), rates, purpose)

    def go_to(self, now_s: float, pan_rad: float, tilt_rad: float, purpose: Purpose) -> PointingCommand:
        """Return the command that brings the head to standing angles."""
        return self._command(now_s, (pan_rad, tilt_rad), (0.0, 0.0), purpose)

    def hold(self, now_s: float) -> PointingCommand:
        """Return the command to stand still where the head is, or to leave what its lens must not see."""
        keep_out, here = self.keep_out, self._here(now_s)
        if keep_out is not None and here is not None:
            angles = (float(here[0]), float(here[1]))
            if not keep_out.allows(now_s + self.latency_s, angles):
                return self._command(now_s, angles, (0.0, 0.0), Purpose.KEEP_OUT)
            keep_out.set_commanded(np.zeros(2))
        pan, tilt = (axis.expected(now_s + self.latency_s, self.latency_s) for axis in (self._pan, self._tilt))
        for axis in (self._pan, self._tilt):
            axis.stopped(now_s)
        return PointingCommand(
            t_s=now_s,
            station=self.geometry.name,
            pan_rad=pan or 0.0,
            tilt_rad=tilt or 0.0,
            pan_rate_rad_s=0.0,
            tilt_rate_rad_s=0.0,
            purpose=Purpose.HOLD,
        )

    def off_rad(self, pan_rad: float, tilt_rad: float, now_s: float) -> float:
        """Return how far the head is from angles now, the larger of both axes; infinite without a reading."""
        pan, tilt = self._pan.expected(now_s, self.latency_s), self._tilt.expected(now_s, self.latency_s)
        return math.inf if pan is None or tilt is None else max(abs(pan - pan_rad), abs(tilt - tilt_rad))

    def _reading_at(self, point_runway_m: FloatArray) -> Aim | None:
        """Return the readings at which the axis meets a point (3,); None if it cannot."""
        aim = aim_at(self.geometry, point_runway_m)
        if aim is None:
            return None
        pan_rad, tilt_rad = aim.pan_rad, aim.tilt_rad
        if self._axes is not None:
            pan_rad, tilt_rad = self._axes.readings(pan_rad, tilt_rad, *self._senses)
        return Aim(pan_rad=self._pan.nearest_turn(pan_rad), tilt_rad=tilt_rad)

    def _here(self, now_s: float) -> FloatArray | None:
        """Return where the head (2,) will be when a command takes effect; None without a reading that is new enough."""
        pan, tilt = (axis.expected(now_s + self.latency_s, self.latency_s) for axis in (self._pan, self._tilt))
        known = pan is not None and tilt is not None and self.age_s(now_s) <= self._config.stale_s
        return np.array([pan, tilt]) if known else None

    def _command(
        self, now_s: float, angles: tuple[float, float], rates: tuple[float, float], purpose: Purpose
    ) -> PointingCommand:
        pan, tilt = self._pan.clipped(angles[0]), self._tilt.clipped(angles[1])
        here = None if self.keep_out is None else self._here(now_s)
        if self.keep_out is not None and here is not None:
            way = self.keep_out.next(now_s + self.latency_s, here, np.array([pan, tilt]))
            if not way.reaches:
                (pan, tilt), rates = (float(a) for a in way.angles_rad), (0.0, 0.0)
        # at a limit there is nothing to follow
        pan_rate = rates[0] if pan == angles[0] else 0.0
        tilt_rate = rates[1] if tilt == angles[1] else 0.0
        pan_rate = self._pan.rate_to(now_s, pan, pan_rate, self.latency_s)
        tilt_rate = self._tilt.rate_to(now_s, tilt, tilt_rate, self.latency_s)
        if self.keep_out is not None and here is not None:
            pan_rate, tilt_rate = self._kept_out(self.keep_out, now_s, here, (pan_rate, tilt_rate))
            # a unit that accepts positions only has not turned at the commanded rates
            read = np.array([self._pan.newest_rad, self._tilt.newest_rad])
            step = self.keep_out.step_towards(now_s + self.latency_s, read, np.array([pan, tilt]))
            pan, tilt = float(step[0]), float(step[1])
            if self.keep_out.held and max(abs(pan_rate), abs(tilt_rate)) < _STANDS_RAD_S:
                purpose, pan_rate, tilt_rate = Purpose.HOLD, *self._replace_rates(now_s, np.zeros(2))
        return PointingCommand(
            t_s=now_s,
            station=self.geometry.name,
            pan_rad=pan,
            tilt_rad=tilt,
            pan_rate_rad_s=pan_rate,
            tilt_rate_rad_s=tilt_rate,
            purpose=purpose,
        )

    def _kept_out(
        self, keep_out: KeepOutController, now_s: float, here: FloatArray, rates: tuple[float, float]
    ) -> tuple[float, float]:
        """Return rates that lead near no closed zone, and that the axes can turn at."""
        act_s = now_s + self.latency_s
        aside = keep_out.turned_aside(act_s, here, np.array(rates))
        bounded = self._replace_rates(now_s, aside)
        slowed = keep_out.slowed(act_s, here, bounded)
        commanded = bounded if np.array_equal(slowed, bounded) else self._replace_rates(now_s, slowed)
        keep_out.set_commanded(commanded)
        return float(commanded[0]), float(commanded[1])

    def _replace_rates(self, now_s: float, rates: FloatArray) -> FloatArray:
        axes = (self._pan, self._tilt)
        return np.array([a.replace_rate(float(v), now_s, self.latency_s) for a, v in zip(axes, rates, strict=True)])


def _keep_out_controller(keep_out: KeepOut, limits: HeadLimits, config: PointingConfig) -> KeepOutController:
    axes, margin = (limits.pan, limits.tilt), math.radians(config.margin_deg)
    return KeepOutController(
        keep_out,
        np.array([a.low_rad + margin for a in axes]),
        np.array([a.high_rad - margin for a in axes]),
        np.array([config.acceleration_share * a.acceleration_rad_s2 for a in axes]),
        lease_s=limits.lease_s,
    )
