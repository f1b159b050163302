"""Worker thread of one station's PTU: polls the angles and executes the newest pointing command.

This is the only place that moves hardware. The newest command counts, older ones are forgotten; a unit that no command
comes for is halted by its driver's watchdog. Whatever ends the thread, the unit is halted. While it is held (there is
no motion guard), the unit is halted and no command is taken.
"""

import contextlib
import math
import threading
from collections.abc import Callable
from typing import Protocol

from groundstation.live.input_queue import DeviceLogLine, Item
from groundstation.live.keep_out_unit import KeepOutError, KeepOutUnit
from groundstation.live.standing_check import StandingCheck
from groundstation.messages import PointingCommand, PtuSample, Purpose
from groundstation.pointing.head_limits import LEASE_S, AxisLimits, HeadLimits
from groundstation.tracking.log_throttle import LogThrottle
from ptu_drivers.errors import LimitError, PtuError
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.messages import AngleSample, AxisDescription, Capability, NoReading, Reading

# a unit that gives nothing is asked no more often than that
_PATIENCE_S = 0.02
_REPORT_AFTER_S = 1.0
# so small a change of rate waits until the watchdog needs a command: the line is for readings
_SAME_RATE_RAD_S = math.radians(0.01)
_REPEAT_S = 0.15
_DELAY_RATE = 0.2
_HEALTH_EVERY_S = 0.2


def head_limits(unit: PanTiltUnit) -> HeadLimits:
    """Return a unit's limits as described by its driver."""
    about = unit.describe()
    own_s = about.lease.renewed_s
    lease_s = max(LEASE_S, own_s) if math.isfinite(own_s) else LEASE_S
    return HeadLimits(pan=_axis_limits(about.pan), tilt=_axis_limits(about.tilt), lease_s=lease_s)


def _axis_limits(axis: AxisDescription) -> AxisLimits:
    return AxisLimits(
        low_rad=axis.low_rad,
        high_rad=axis.high_rad,
        fastest_rad_s=axis.max_rate_rad_s,
        slowest_rad_s=axis.min_rate_rad_s,
        acceleration_rad_s2=axis.max_acceleration_rad_s2,
    )


class PanTiltAligner:
    """Pan and tilt as if read at one instant: the unit's two answers are some milliseconds apart.

    The axis that was read later is taken between its last two readings, at the earlier one's instant. Where they are
    one answer, nothing is done to them.
    """

    def __init__(self, station: str, session_from_unit_s: float) -> None:
        self._station = station
        self._zero_s = session_from_unit_s
        self._last: Reading | None = None

    def sample(self, reading: Reading) -> PtuSample | None:
        """Return both angles at one session time; None for the first of a unit that answers one by one."""
        last, self._last = self._last, reading
        early, late = sorted((reading.pan, reading.tilt), key=lambda a: a.t_s)
        angles = {early.axis: early.angle_rad, late.axis: late.angle_rad}
        if late.t_s > early.t_s:
            if last is None:
                return None
            before = last.pan if late.axis is last.pan.axis else last.tilt
            angles[late.axis] = _between(before, late, early.t_s)
        pan, tilt = angles[reading.pan.axis], angles[reading.tilt.axis]
        return PtuSample(t_s=early.t_s + self._zero_s, station=self._station, pan_rad=pan, tilt_rad=tilt)


def _between(before: AngleSample, after: AngleSample, t_s: float) -> float:
    span_s = after.t_s - before.t_s
    if span_s <= 0.0 or t_s < before.t_s:
        return after.angle_rad
    return before.angle_rad + (after.angle_rad - before.angle_rad) * (t_s - before.t_s) / span_s


class ItemSink(Protocol):
    """Receiver of readings and log lines; an `InputQueue`, here or in another process."""

    def put(self, item: Item) -> None:
        """Take it; never waits."""


class HeadWorker:
    """Polls and moves one unit.

    Parameters
    ----------
    unit : opened and probed; its clock is the one that ``session_from_unit_s`` is added to.
    input_queue : takes readings and messages.
    period_s : asked no more often than that.
    clock : the unit's.
    """

    def __init__(
        self,
        station: str,
        unit: PanTiltUnit,
        input_queue: ItemSink,
        *,
        session_from_unit_s: float,
        clock: Callable[[], float],
        period_s: float = 0.01,
    ) -> None:
        self.station = station
        self.unit = unit
        self.readings = 0
        self.refused = 0
        self.newest_s = -math.inf
        self._input_queue = input_queue
        self._zero_s = session_from_unit_s
        self._clock = clock
        self._period_s = period_s
        self._aligner = PanTiltAligner(station, session_from_unit_s)
        self._by_rate = Capability.VELOCITY in unit.describe().capabilities
        self._command: PointingCommand | None = None
        self.delay_s = 0.0
        """Time from a command to its acknowledgement, recent, s."""
        self._sent: PointingCommand | None = None
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._quiet_since_s: float | None = None
        self._reported_reason: str = ""
        self._throttle = LogThrottle(lambda _, text: self._log("warning", text))
        if isinstance(unit, KeepOutUnit):
            unit.report = lambda text: self._log("warning", f"PTU: {text}")
        self.last_cycle_s = math.inf
        """Start of the thread's last cycle, on the unit's clock; infinite before the first."""
        self.health = unit.health()
        """As it was a moment ago: asking the unit itself may wait for its line."""
        self._health_s = -math.inf
        self._held = self._held_still = False
        self._standing = StandingCheck()
        self._thread = threading.Thread(target=self._work, name=f"ptu-{station}", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def set_command(self, command: PointingCommand) -> None:
        """Set the newest command, replacing an older one; does not block."""
        with self._lock:
            self._command = command

    def set_hold(self, held: bool) -> None:
        """Hold the unit still regardless of commands, or release it once it stands; does not block."""
        self._held = held

    @property
    def ended(self) -> bool:
        """Whether the thread has begun and ended, for whatever reason."""
        return self._thread.ident is not None and not self._thread.is_alive()

    def request_stop(self) -> None:
        """Request that the thread halts the unit, closes it and ends; does not block."""
        self._stop.set()

    def stop(self) -> bool:
        """Halt and close the unit; returns whether it acknowledged the halt."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)
        self.unit.close()
        return not self.unit.health().halt_owed

    # ------------------------------------------------------------------------------------ the thread
    def _work(self) -> None:
        try:
            while not self._stop.is_set():
                began_s = self.last_cycle_s = self._clock()
                if self._held or self._standing.is_awaited(began_s):
                    self._hold_still()
                else:
                    self._held_still = False
                    self._execute()
                heard = self._poll()
                if began_s >= self._health_s + _HEALTH_EVERY_S:
                    self._health_s = began_s
                    self.health = self.unit.health()
                left_s = (self._period_s if heard else _PATIENCE_S) - (self._clock() - began_s)
                if left_s > 0:
                    self._stop.wait(left_s)
        except Exception as fault:  # noqa: BLE001 - whatever it is: the head stops and the operator hears of it
            # where memory is short there may be none for the line either
            with contextlib.suppress(MemoryError):
                self._log("error", f"PTU: {type(fault).__name__}: {fault}; it is halted")
        finally:
            self.unit.close()

    def _poll(self) -> bool:
        """Read the angles; returns whether there are any."""
        reading = self.unit.read()
        now_s = self._clock() + self._zero_s
        if isinstance(reading, NoReading):
            if self._quiet_since_s is None:
                self._quiet_since_s = now_s
            elif now_s - self._quiet_since_s > _REPORT_AFTER_S and self._reported_reason != reading.reason.value:
                self._reported_reason = reading.reason.value
                self._log("warning", f"PTU gives no angles: {reading.reason.value} ({reading.state.value})")
            return False
        if self._reported_reason:
            self._log("info", "PTU gives angles again")
        self._quiet_since_s, self._reported_reason = None, ""
        self._standing.take(reading)
        sample = self._aligner.sample(reading)
        if sample is not None:
            self.readings += 1
            self.newest_s = sample.t_s
            self._input_queue.put(sample)
        return True

    def _execute(self) -> None:
        """Execute the newest command once."""
        with self._lock:
            command, self._command = self._command, None
        if command is None or self._same(command):
            return
        self._sent = command
        try:
            if command.purpose is Purpose.HOLD:
                self.unit.halt()
            elif self._by_rate:
                self.unit.move_at(pan_rad_s=command.pan_rate_rad_s, tilt_rad_s=command.tilt_rate_rad_s)
            else:
                self.unit.move_to(pan_rad=command.pan_rad, tilt_rad=command.tilt_rad)
            took_s = self._clock() + self._zero_s - command.t_s
            self.delay_s += _DELAY_RATE * (took_s - self.delay_s)
        except KeepOutError as fault:
            self.refused += 1
            self._throttle.take(command.t_s, f"PTU: {fault}")
        except LimitError as fault:
            self.refused += 1
            self._log("warning", f"PTU: {fault}")
        except PtuError as fault:
            # the next reading reports what is wrong with the line
            self.refused += 1
            if self.refused == 1:
                self._log("warning", f"PTU: {fault}")

    def _hold_still(self) -> None:
        """Halt the unit, once it has acknowledged no more, and forget what is commanded meanwhile."""
        with self._lock:
            self._command = self._sent = None
        if self._held_still:
            return
        try:
            self.unit.halt()
            self._held_still = True
            # the cause may be over before the unit has braked: it stands first all the same
            self._standing.begin(self._clock())
        except PtuError as fault:
            # tried again in the next round; the driver owes it, too
            self.refused += 1
            if self.refused == 1:
                self._log("warning", f"PTU: {fault}")

    def _same(self, command: PointingCommand) -> bool:
        """Return whether the command repeats the last one sent."""
        last = self._sent
        if last is None or command.t_s - last.t_s > _REPEAT_S or command.purpose is not last.purpose:
            return False
        apart = max(
            abs(command.pan_rate_rad_s - last.pan_rate_rad_s), abs(command.tilt_rate_rad_s - last.tilt_rate_rad_s)
        )
        return self._by_rate and apart < _SAME_RATE_RAD_S

    def _log(self, level: str, text: str) -> None:
        self._input_queue.put(
            DeviceLogLine(t_s=self._clock() + self._zero_s, level=level, text=f"{self.station}: {text}")
        )
