"""Common base of the drivers of units that are polled.

Lock, limits, counts, watchdog, halt and reconnection are here. A
protocol adds how to ask, move, halt and set up. Its angles are the unit's own, before the settings' sign and zero.
"""

from abc import abstractmethod
from typing import Protocol

from ptu_drivers.axis_limits import check_angle, check_rate
from ptu_drivers.errors import LineError, NoAnswerError, PtuError, RefusedError, UnsupportedError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason, Health, HealthCounter, UnitState
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.line_lock import LineLock
from ptu_drivers.messages import Axis, Capability, NoReading, Reading, UnitDescription
from ptu_drivers.rate_motion import RateMotion
from ptu_drivers.settings import AxisSettings, UnitSettings
from ptu_drivers.watchdog import Watchdog

# timeouts in a row after which the line is opened again: a socket can be half open, an adapter asleep
_SILENCES = 4
_REOPEN_S = 0.2
_HALT_TRIES = 3
# motion by rate is looked at this often by itself, so that it can be stopped at a limit
_LOOK_S = 0.1


class Line(Protocol):
    """What the common part needs of a line; a `Transport`, or a connection of another kind."""

    url: str
    lock: LineLock
    """Who uses it; an exchange gives up when a halt waits."""

    def now(self) -> float:
        """Return the clock, s."""

    def wait(self, duration_s: float) -> None:
        """Let time pass."""

    def reopen(self) -> None:
        """Close and open again. Raises LineError."""

    def close(self) -> None:
        """Let go; never raises."""


class PolledUnit(PanTiltUnit):
    """The common part; see the module.

    Parameters
    ----------
    line : the line, open; owned by this from now on.
    settings : as given to `open_ptu`.
    description : what the probe found.
    health : the counts of the probe, to be carried on.
    watch : run the watchdog in a thread; without, it is looked at with each call (time that is simulated).
    """

    def __init__(
        self, line: Line, settings: UnitSettings, description: UnitDescription, health: HealthCounter, *, watch: bool
    ) -> None:
        self._line = line
        self._settings = settings
        self._description = description
        self._health = health
        self._health.state = UnitState.READY
        self._lock = line.lock
        self._closed = False
        self._silences = 0
        self._next_reopen_s = float("-inf")
        self._until_s = float("inf")
        """When the present call must be over, s."""
        self._turning = RateMotion(description=description)
        self._last: Reading | None = None
        self._watches = watch
        self._watchdog: Watchdog | None = None

    @abstractmethod
    def _query(self) -> Reading:
        """Ask both axes; raises ExchangeFailed, LineError."""

    @abstractmethod
    def _resynchronise(self) -> None:
        """Match answers to questions again after a failure; raises ExchangeFailed, LineError."""

    @abstractmethod
    def _set_up(self) -> None:
        """After the line was opened again: set what the unit may have lost; raises ExchangeFailed, LineError."""

    @abstractmethod
    def _send_position(self, targets: dict[Axis, float], rate_rad_s: float | None) -> None:
        """Command positions, the unit's own rad; raises ExchangeFailed, RefusedError, LineError."""

    @abstractmethod
    def _send_rates(self, rates: dict[Axis, float]) -> None:
        """Command rates, the unit's own rad/s; raises ExchangeFailed, RefusedError, LineError."""

    @abstractmethod
    def _send_halt(self) -> None:
        """Stop both axes; raises ExchangeFailed, RefusedError, LineError."""

    def describe(self) -> UnitDescription:
        """Return what the probe found."""
        return self._description

    def health(self) -> Health:
        """Return the counts until now."""
        with self._lock:
            return self._health.snapshot()

    def read(self) -> Reading | NoReading:
        """Ask both axes where they are."""
        with self._lock:
            self._begin()
            self._check_watchdog()
            try:
                if self._health.state is not UnitState.READY:
                    self._recover()
                reading = self._query()
            except RefusedError as refused:
                return self._note_failure(ExchangeFailed(FailureReason.REFUSED, str(refused)))
            except (ExchangeFailed, LineError) as fault:
                return self._note_failure(fault)
            self._silences = 0
            self._health.state = UnitState.READY
            self._health.readings += 1
            self._last = reading
            self._health.last_reading_s = max(reading.pan.t_s, reading.tilt.t_s)
            self._stop_at_limits(reading)
            if self._health.halt_owed:
                self._try_halt()
            return reading

    def move_to(
        self, *, pan_rad: float | None = None, tilt_rad: float | None = None, rate_rad_s: float | None = None
    ) -> None:
        """Start to turn to a position."""
        asked = {a: v for a, v in ((Axis.PAN, pan_rad), (Axis.TILT, tilt_rad)) if v is not None}
        with self._lock:
            self._begin()
            if rate_rad_s is not None and Capability.SPEED not in self._description.capabilities:
                raise UnsupportedError(self._description.protocol, got="a speed for a move to a position")
            for axis, value in asked.items():
                check_angle(axis, self._description.axis(axis), value)
                if rate_rad_s is not None:
                    check_rate(axis, self._description.axis(axis), rate_rad_s)
            self._turning.end()
            targets = {axis: self._axis(axis).unit_angle(value) for axis, value in asked.items()}
            self._command("move", lambda: self._send_position(targets, rate_rad_s))

    def move_at(self, *, pan_rad_s: float, tilt_rad_s: float) -> None:
        """Turn at a rate until the next command."""
        with self._lock:
            self._begin()
            if Capability.VELOCITY not in self._description.capabilities:
                raise UnsupportedError(self._description.protocol, got="a rate")
            asked = {Axis.PAN: pan_rad_s, Axis.TILT: tilt_rad_s}
            self._turning.begin(asked, self._line.now(), self._last)
            rates = {axis: self._axis(axis).sign * value for axis, value in asked.items()}
            # before anything turns: a command that fails may still have been taken
            if self._watches and self._watchdog is None:
                self._watchdog = Watchdog(self._watch, min(_LOOK_S, self._settings.watchdog_s / 4 or _LOOK_S))
            self._command("turn", lambda: self._send_rates(rates))
            if self._line.now() - self._health.last_reading_s > _LOOK_S:
                self.read()

    def halt(self) -> None:
        """Stop both axes now."""
        with self._lock.for_halt():
            self._begin()
            self._halt()

    def home(self) -> None:
        """Reset and home; units of these protocols cannot be asked to."""
        with self._lock:
            self._begin()
            raise UnsupportedError(self._description.protocol, got="a request to home")

    def close(self) -> None:
        """Halt and let go of the line."""
        with self._lock.for_halt():
            if self._closed:
                return
            if self._watchdog is not None:
                self._watchdog.stop()
            self._try_again()
            self._try_halt(_HALT_TRIES)
            self._try_again()
            try:
                if not self._health.halt_owed:
                    self._release()
            except (ExchangeFailed, PtuError) as fault:
                self._health.failures[
                    fault.reason if isinstance(fault, ExchangeFailed) else FailureReason.LINE_LOST
                ] += 1
            self._closed = True
            self._health.state = UnitState.CLOSED
            self._line.close()

    def _release(self) -> None:
        """After the last halt: what else a unit needs before it is left alone."""

    def _axis(self, axis: Axis) -> AxisSettings:
        return self._settings.pan if axis is Axis.PAN else self._settings.tilt

    def _begin(self) -> None:
        """Begin a call: the unit must be open, and the call has its time from now on."""
        if self._closed:
            raise LineError(self._description.url, got="a unit that was closed", wanted="an open one")
        self._try_again()

    def _try_again(self) -> None:
        """Give the call the time of one exchange from now on."""
        self._until_s = self._line.now() + self._description.reply_timeout_s

    def _command(self, name: str, send: "_Send") -> None:
        """Send once; what is not acknowledged may still move, and is halted when the line is back."""
        began = self._line.now()
        try:
            if self._health.state is not UnitState.READY:
                self._recover()
            send()
        except RefusedError:
            # one axis may have taken it
            self._turning.end()
            self._health.halt_owed = True
            raise
        except (ExchangeFailed, LineError) as fault:
            self._turning.end()
            self._health.halt_owed = True
            self._note_failure(fault)
            if isinstance(fault, LineError):
                raise
            raise NoAnswerError(name, waited_s=self._line.now() - began, got=str(fault)) from fault
        # a new command replaces the motion that the halt was owed for
        self._health.halt_owed = False
        self._health.state = UnitState.READY
        self._silences = 0

    def _halt(self, tries: int = _HALT_TRIES) -> None:
        self._turning.end()
        self._health.halt_owed = True
        began = self._line.now()
        last: ExchangeFailed | LineError | None = None
        for n in range(tries):
            if n:
                self._try_again()
            try:
                if self._health.state is UnitState.LINE_LOST:
                    self._reconnect()
                # no resynchronisation first: a halt that may be heard is worth more than an answer that is certain
                self._send_halt()
            except (ExchangeFailed, LineError) as fault:
                last = fault
                self._note_failure(fault)
                if isinstance(fault, LineError):
                    break
            else:
                self._health.halt_owed = False
                return
        if isinstance(last, LineError):
            raise last
        raise NoAnswerError("halt", waited_s=self._line.now() - began, got=str(last))

    def _try_halt(self, tries: int = 1) -> None:
        """Halt; failure stays owed."""
        try:
            self._halt(tries)
        except PtuError:
            return

    def _note_failure(self, fault: ExchangeFailed | LineError) -> NoReading:
        """Count a failed exchange and choose the recovery step."""
        if isinstance(fault, LineError):
            reason = FailureReason.LINE_LOST
            self._lose()
        else:
            reason = fault.reason
            silent = reason in (FailureReason.TIMEOUT, FailureReason.LINE_LOST)
            self._silences = self._silences + 1 if silent else 0
            if self._health.state is UnitState.READY:
                self._health.state = UnitState.RESYNCHRONISING
                self._health.resyncs += 1
            if self._silences >= _SILENCES and self._health.state is not UnitState.LINE_LOST:
                self._lose()
        self._health.failures[reason] += 1
        return NoReading(reason=reason, state=self._health.state, t_s=self._line.now())

    def _lose(self) -> None:
        self._silences = 0
        if self._turning.rates is not None:
            self._health.halt_owed = True
            self._turning.end()
        self._health.state = UnitState.LINE_LOST

    def _recover(self) -> None:
        if self._health.state is UnitState.LINE_LOST:
            self._reconnect()
            self._set_up()
        self._resynchronise()

    def _reconnect(self) -> None:
        now = self._line.now()
        if now < self._next_reopen_s:
            self._line.wait(min(self._next_reopen_s, self._until_s) - now)
        self._next_reopen_s = self._line.now() + _REOPEN_S
        self._line.reopen()
        self._health.reconnects += 1
        self._health.state = UnitState.RESYNCHRONISING

    def _check_watchdog(self) -> None:
        """Halt motion by rate that was not renewed in time."""
        if self._turning.is_overdue(self._line.now(), self._settings.watchdog_s):
            self._health.watchdog_stops += 1
            self._try_halt()

    def _stop_at_limits(self, reading: Reading) -> None:
        """Halt motion by rate that would pass a limit before the next look."""
        if self._turning.nears_limit(reading, self._line.now()):
            self._health.limit_events += 1
            self._try_halt()

    def _watch(self) -> None:
        """Supervise motion by rate: the command timeout and the limits."""
        with self._lock:
            if self._closed:
                return
            if self._health.halt_owed:
                # a halt that was not acknowledged is tried until it is, whether or not anybody reads
                self._try_again()
                self._try_halt()
                return
            if not self._turning.turns():
                return
            self._try_again()
            self._check_watchdog()
            if self._line.now() - self._health.last_reading_s > _LOOK_S:
                self.read()


class _Send(Protocol):
    def __call__(self) -> None: ...
