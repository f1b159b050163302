"""Common base of all drivers: a unit that is polled, and the recovery from line faults of every call.

Lock, limits, counts, watchdog, halt and shutdown are here. A protocol adds its queries, moves, halt and set-up, and
its particularities (docs/ptu.md). Its angles are the unit's own, before the settings' sign and zero.
"""

from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress

from ptu_drivers.axis_limits import check_angle, check_rate, check_speed
from ptu_drivers.errors import LineError, NoAnswerError, PtuError, RefusedError, UnsupportedError
from ptu_drivers.exchange_failed import ExchangeFailed, reason_of
from ptu_drivers.health import FailureReason, Health, HealthCounter, UnitState
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.line_lock import LockedLine
from ptu_drivers.messages import Axis, Capability, NoReading, Reading, UnitDescription
from ptu_drivers.rate_motion import RateMotion
from ptu_drivers.reconnection import Reconnection
from ptu_drivers.settings import AxisSettings, UnitSettings
from ptu_drivers.watchdog import Watchdog

_HALT_TRIES = 3
# period of the check of motion by rate, so that it can be stopped at a limit
_LOOK_S = 0.1


class PolledUnit(PanTiltUnit):
    """The common part; see the module.

    Parameters
    ----------
    line : the line, open; owned by this object.
    settings : as given to `open_ptu`.
    description : the result of the probe.
    health : the counts of the probe, to be continued.
    watch : run the watchdog in a thread; otherwise it is checked in each call (simulated time).
    """

    _stale_s = _LOOK_S
    """After the command of a rate, angles that are older are read again, s."""

    def __init__(
        self,
        line: LockedLine,
        settings: UnitSettings,
        description: UnitDescription,
        health: HealthCounter,
        *,
        watch: bool,
    ) -> None:
        self._line = line
        self._settings = settings
        self._description = description
        self._health = health
        self._health.state = UnitState.READY
        self._lock = line.lock
        self._closed = False
        self._reconnection = Reconnection(line, health)
        self._until_s = float("inf")
        """When the present call must be over, s."""
        self._turning = RateMotion(description=description)
        self._last: Reading | None = None
        self._watches = watch
        self._watchdog: Watchdog | None = None

    @abstractmethod
    def _query(self) -> Reading:
        """Query both axes; raises ExchangeFailed, LineError."""

    @abstractmethod
    def _send_position(self, targets: dict[Axis, float], rate_rad_s: float | None) -> None:
        """Command positions, the unit's own rad; raises ExchangeFailed, RefusedError, LineError."""

    @abstractmethod
    def _send_rates(self, rates: dict[Axis, float]) -> None:
        """Command rates, the unit's own rad/s; raises ExchangeFailed, RefusedError, LineError."""

    @abstractmethod
    def _send_halt(self) -> None:
        """Stop both axes; raises ExchangeFailed, RefusedError, LineError."""

    def _resynchronise(self) -> None:
        """Match replies to queries again after a failure; raises ExchangeFailed, LineError."""

    def _set_up(self) -> None:
        """After the line was reopened: restore the unit's settings; raises ExchangeFailed, LineError."""

    def _recover(self) -> FailureReason | None:
        """Bring line and unit back; return why that is not done yet, None where the unit can be asked now.

        Raises ExchangeFailed, RefusedError, LineError, which are noted where they are caught.
        """
        if self._health.state is UnitState.LINE_LOST:
            self._reconnection.reopen(self._until_s)
            self._set_up()
        self._resynchronise()
        return None

    def _recover_to_halt(self) -> FailureReason | None:
        """Recover the line as far as a halt needs; return why it cannot be sent, None where it can. Raises the same.

        No resynchronisation first: a halt that may be received has priority over a certain reply.
        """
        if self._health.state is UnitState.LINE_LOST:
            self._reconnection.reopen(self._until_s)
        return None

    def _note_failure(self, fault: ExchangeFailed | LineError) -> FailureReason:
        """Count a failed exchange and choose the recovery step; return its reason."""
        reason = self._reconnection.note_failure(fault)
        if self._health.state is UnitState.LINE_LOST and self._turning.rates is not None:
            self._turning.end()
            self._health.halt_owed = True
        return reason

    def _keep_motion(self) -> FailureReason | None:
        """Before a question: end motion by rate that is overdue; return why there will be no angles, if so."""
        self._check_watchdog()
        return None

    def _check_room(self, asked: dict[Axis, float]) -> None:
        """Return if the axes have room to turn at these rates, rad/s. Raises LimitError, NoAnswerError."""
        self._turning.check_room(asked, self._last)

    def _stop_at_limits(self, reading: Reading) -> FailureReason | None:
        """Halt motion by rate that would pass a limit before the next check; return as `_keep_motion`."""
        if self._turning.nears_limit(reading, self._line.now()):
            self._health.limit_events += 1
            self._try_halt()
        return None

    def _note_refusal(self) -> None:
        """After a command that was refused: one axis may have taken it."""
        self._turning.end()
        self._health.halt_owed = True

    def _halt_blind(self) -> None:
        """Send a halt without waiting, where it can be received; never raises."""

    def _release(self) -> None:
        """After the last halt: the protocol's shutdown commands; raises ExchangeFailed, PtuError."""

    def describe(self) -> UnitDescription:
        """Return the result of the probe."""
        return self._description

    def health(self) -> Health:
        """Return the counts until now."""
        with self._lock:
            return self._health.snapshot()

    def read(self) -> Reading | NoReading:
        """Query the position of both axes."""
        with self._lock:
            self._begin()
            got = self._keep_motion() or self._ask()
            if not isinstance(got, Reading):
                return NoReading(reason=got, state=self._health.state, t_s=self._line.now())
            if self._health.halt_owed:
                self._try_halt()
            return got

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
                    check_speed(axis, self._description.axis(axis), rate_rad_s)
            targets = {axis: self._axis(axis).unit_angle(value) for axis, value in asked.items()}

            def send() -> None:
                self._turning.end()
                self._send_position(targets, rate_rad_s)

            self._command("move", send)

    def move_at(self, *, pan_rad_s: float, tilt_rad_s: float) -> None:
        """Turn at a rate until the next command."""
        with self._lock:
            self._begin()
            if Capability.VELOCITY not in self._description.capabilities:
                raise UnsupportedError(self._description.protocol, got="a rate")
            asked = {Axis.PAN: pan_rad_s, Axis.TILT: tilt_rad_s}
            for axis, value in asked.items():
                check_rate(axis, self._description.axis(axis), value)
            self._check_room(asked)
            self._turning.begin(asked, self._line.now())
            rates = {axis: self._axis(axis).sign * value for axis, value in asked.items()}
            # before anything turns: a command that fails may still have been taken
            if self._watches and self._watchdog is None:
                self._watchdog = Watchdog(self._watch, min(_LOOK_S, self._settings.watchdog_s / 4 or _LOOK_S))
            self._command("turn", lambda: self._send_rates(rates))
            if self._line.now() - self._health.last_reading_s > self._stale_s:
                self.read()

    def halt(self) -> None:
        """Stop both axes now."""
        with self._lock.for_halt():
            self._begin()
            self._halt_at_once()

    def home(self) -> None:
        """Reset and home; most protocols have no command for it."""
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
            with suppress(PtuError):
                self._halt_at_once()
            self._try_again()
            try:
                if not self._health.halt_owed:
                    self._release()
            except (ExchangeFailed, PtuError) as fault:
                self._health.failures[reason_of(fault)] += 1
            if self._health.halt_owed:
                # the line is dead: once more, it may carry one way
                self._halt_blind()
            self._closed = True
            self._health.state = UnitState.CLOSED
            self._line.close()

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

    def _ask(self) -> Reading | FailureReason:
        """Return both angles, or the reason of the failure; recovers before where that is due."""
        try:
            if not self._health.is_ready() and (reason := self._recover()):
                return reason
            reading = self._query()
        except RefusedError as refused:
            return self._note_failure(ExchangeFailed(FailureReason.REFUSED, str(refused)))
        except (ExchangeFailed, LineError) as fault:
            return self._note_failure(fault)
        self._reconnection.note_answer()
        self._health.readings += 1
        self._last = reading
        self._health.last_reading_s = max(reading.pan.t_s, reading.tilt.t_s)
        return self._stop_at_limits(reading) or reading

    def _command(self, name: str, send: Callable[[], None]) -> None:
        """Recover where that is due, and send; raises NoAnswerError, RefusedError, LineError."""
        began = self._line.now()

        def recover_and_send() -> None:
            self._make_ready(name)
            send()

        fault = self._attempt(recover_and_send)
        if isinstance(fault, LineError):
            raise fault
        if fault is not None:
            raise NoAnswerError(name, waited_s=self._line.now() - began, got=str(fault)) from fault

    def _make_ready(self, name: str) -> None:
        """Recover where that is due; raises NoAnswerError where it takes more calls, and as `_recover`."""
        began = self._line.now()
        if not self._health.is_ready() and self._recover() and not self._health.is_ready():
            raise NoAnswerError(name, waited_s=self._line.now() - began, got=f"state: {self._health.state}")

    def _attempt(self, send: Callable[[], None]) -> ExchangeFailed | LineError | None:
        """Send once, and return the failure; motion without acknowledgement is halted on the next reply.

        Raises RefusedError, and other exceptions of `send`.
        """
        try:
            send()
        except RefusedError:
            self._note_refusal()
            raise
        except (ExchangeFailed, LineError) as fault:
            self._turning.end()
            self._health.halt_owed = True
            self._note_failure(fault)
            return fault
        # a new command replaces the motion that the halt was owed for
        self._health.halt_owed = False
        self._reconnection.note_answer()
        return None

    def _halt_at_once(self) -> None:
        """Halt, first without a query where a reply is in doubt; raises as `halt`."""
        if not self._health.is_ready():
            self._health.halt_owed = True
            self._halt_blind()
            self._try_again()
        self._halt(_HALT_TRIES)

    def _halt(self, tries: int) -> None:
        self._turning.end()
        self._health.halt_owed = True
        began, got = self._line.now(), ""
        for n in range(tries):
            if n:
                self._try_again()
            try:
                if self._recover_to_halt() is None and self._health.halt_owed:
                    self._send_halt()
                    self._health.halt_owed = False
                got = f"state: {self._health.state}"
            except (ExchangeFailed, LineError) as fault:
                self._note_failure(fault)
                if isinstance(fault, LineError):
                    raise
                got = str(fault)
            if not self._health.halt_owed:
                return
        raise NoAnswerError("halt", waited_s=self._line.now() - began, got=got)

    def _try_halt(self) -> None:
        """Halt; failure stays owed."""
        with suppress(PtuError):
            self._halt(1)

    def _check_watchdog(self) -> None:
        """Halt motion by rate that was not renewed in time."""
        if self._turning.is_overdue(self._line.now(), self._settings.watchdog_s):
            self._health.watchdog_stops += 1
            self._try_halt()

    def _watch(self) -> None:
        """Supervise motion by rate: the command timeout and the limits."""
        with self._lock:
            if self._closed:
                return
            self._try_again()
            if self._health.halt_owed:
                # a halt that was not acknowledged is repeated until it is, with or without calls of `read`
                self._try_halt()
            elif self._turning.turns():
                self._check_watchdog()
                if self._line.now() - self._health.last_reading_s > _LOOK_S:
                    self.read()
