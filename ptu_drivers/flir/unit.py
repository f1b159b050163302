"""FLIR / Directed Perception pan-tilt units over their ASCII protocol: the device."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from ptu_drivers.errors import LineError, NoAnswerError, PtuError, RefusedError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.flir.description import describe_unit
from ptu_drivers.flir.line import LONGEST_ANSWER_CHARACTERS, FlirLine
from ptu_drivers.flir.poll import Poller, Query
from ptu_drivers.flir.probe import LETTER, UnitFacts
from ptu_drivers.flir.rate_chain import RateChain
from ptu_drivers.flir.recovery import DEFAULT_BAUD, Recovery
from ptu_drivers.flir.unit_conversion import Converter
from ptu_drivers.health import FailureReason, Health, HealthCounter, UnitState
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.line_lock import LineLock
from ptu_drivers.messages import Axis, NoReading, Reading, UnitDescription
from ptu_drivers.settings import UnitSettings
from ptu_drivers.transport import BITS_PER_CHARACTER
from ptu_drivers.watchdog import Watchdog

# the line is emptied for so long at most before the question is repeated
DRAINING_S = 0.25
_HALTS = 3
_WATCH_S = 0.1
# commands of one call, which a unit that takes ten a second keeps apart: three times both angles, where nothing is yet
# known of them, speed and target of both axes
_COMMANDS = 10


class FlirUnit(PanTiltUnit):
    """A probed unit; made by `open_flir` or `connect`."""

    def __init__(
        self,
        line: FlirLine,
        lock: LineLock,
        counter: HealthCounter,
        facts: UnitFacts,
        settings: UnitSettings,
        *,
        threaded: bool,
    ) -> None:
        self._lock = lock
        self._line = line
        self._transport = line.transport
        self._counter = counter
        self._facts = facts
        self._settings = settings
        slowest = min(DEFAULT_BAUD, self._transport.baud() or DEFAULT_BAUD)
        self._limit_s = settings.reply_timeout_s + DRAINING_S + _COMMANDS * facts.pace_s
        self._limit_s += LONGEST_ANSWER_CHARACTERS * BITS_PER_CHARACTER / slowest
        self._until_s = float("inf")
        """When the present call must be over, s."""
        self._description = describe_unit(facts, self._transport, settings, self._limit_s)
        self._convert = Converter(facts=facts, description=self._description, settings=settings)
        self._poller = Poller(line, facts, self._convert, settings)
        self._recovery = Recovery(line, counter, self._setup)
        self._rates = {axis: facts.axis(axis).rate for axis in Axis}
        """Speeds of moves to positions, counts/s."""
        self._chain = RateChain(self._convert, self._command, self._transport.now)
        self._turning: dict[Axis, float] = {}
        self._moving = False
        self._commanded_s = self._transport.now()
        self._last: Reading | None = None
        self._watchdog: Watchdog | None = None
        self._threaded = threaded
        counter.state = UnitState.READY

    def use_query(self, query: Query, *, type_ahead: bool = True) -> None:
        """Ask angles in this way from now on, whatever the probe found best."""
        self._poller.query = query
        self._poller.type_ahead = type_ahead
        self._poller.forget()

    def describe(self) -> UnitDescription:
        """Return what the probe found."""
        return self._description

    def health(self) -> Health:
        """Return the counts until now."""
        return self._counter.snapshot()

    def read(self) -> Reading | NoReading:
        """Ask both axes where they are."""
        with self._lock:
            self._begin()
            if self._is_ready():
                reason = self._look_after() or self._poll()
                if isinstance(reason, Reading):
                    return reason
            else:
                reason = self._advance()
            return NoReading(reason=reason, state=self._counter.state, t_s=self._transport.now())

    def _poll(self) -> Reading | FailureReason:
        try:
            reading = self._poller.poll(self._until_s)
        except ExchangeFailed as failure:
            self._recovery.record_failure(failure.reason)
            return failure.reason
        except LineError:
            self._recovery.record_failure(FailureReason.LINE_LOST)
            return FailureReason.LINE_LOST
        self._last = reading
        self._chain.observe(reading)
        self._recovery.note_answer()
        self._counter.readings += 1
        self._counter.last_reading_s = max(reading.pan.t_s, reading.tilt.t_s)
        return self._driven(lambda: self._guard(reading)) or reading

    def _look_after(self) -> FailureReason | None:
        """Halt motion by rate that no command renews; see that else it goes on. Return why that could not be done."""
        if not any(self._turning.values()):
            return None
        late = self._settings.watchdog_s and self._transport.now() - self._commanded_s > self._settings.watchdog_s
        if not late:
            return self._driven(self._chain.renew)
        self._counter.watchdog_stops += 1
        return self._driven(self._halt_both)

    def _driven(self, drive: Callable[[], None]) -> FailureReason | None:
        """Carry out commands of the driver's own; return why that could not be done."""
        try:
            drive()
        except ExchangeFailed as failure:
            return failure.reason
        except LineError:
            return FailureReason.LINE_LOST
        except RefusedError:
            self._stop_turning()
            return FailureReason.REFUSED
        return None

    def _advance(self) -> FailureReason:
        if self._counter.state is UnitState.LINE_LOST and self._moving:
            # whatever was commanded before goes on meanwhile
            self._counter.halt_owed = True
        owed = self._counter.halt_owed
        reason = self._recovery.advance(self._until_s)
        if self._recovery.restarted:
            self._recovery.restarted = False
            self._poller.forget()
            self._stand()
            self._chain.stand(self._rates)
        elif owed and not self._counter.halt_owed:
            self._stand()
        return reason

    def _stand(self) -> None:
        """Both axes were halted, or restarted: no motion by rate is left."""
        self._moving = False
        self._turning = {}
        self._chain.stand()

    def move_to(
        self, *, pan_rad: float | None = None, tilt_rad: float | None = None, rate_rad_s: float | None = None
    ) -> None:
        """Start to turn to a position."""
        with self._lock:
            self._begin()
            wanted = {a: v for a, v in zip(Axis, (pan_rad, tilt_rad), strict=True) if v is not None}
            counts = {axis: self._convert.position(axis, angle) for axis, angle in wanted.items()}
            rates = dict(self._rates)
            if rate_rad_s is not None:
                rates |= {axis: abs(self._convert.rate(axis, rate_rad_s, still=False)) for axis in wanted}
            self._must_be_ready()
            self._turning = {}
            self._moving = self._moving or bool(counts)
            with self._answered("a position"):
                for axis in wanted:
                    self._chain.set_speed(axis, rates[axis])
                    self._rates[axis] = rates[axis]
                self._chain.go(counts)
            self._commanded_s = self._transport.now()

    def move_at(self, *, pan_rad_s: float, tilt_rad_s: float) -> None:
        """Turn at a rate until the next command."""
        with self._lock:
            self._begin()
            wanted = dict(zip(Axis, (pan_rad_s, tilt_rad_s), strict=True))
            counts = {axis: self._convert.rate(axis, rate) for axis, rate in wanted.items()}
            self._must_be_ready()
            if any(counts.values()):
                self._know_where()
            if self._last is not None:
                for axis, rate in wanted.items():
                    if self._turning.get(axis, 0.0) == 0.0 and (limit := self._convert.outward(axis, self._last, rate)):
                        raise limit
            self._turning = dict(wanted)
            self._moving = True
            self._commanded_s = self._transport.now()
            # before anything turns: one axis may turn though the other one's command fails
            if self._threaded and self._watchdog is None:
                self._watchdog = Watchdog(self._watch, _WATCH_S)
            try:
                with self._answered("a rate"):
                    self._chain.turn(counts)
            except RefusedError:
                self._stop_turning()
                raise
            self._commanded_s = self._transport.now()

    def _know_where(self) -> None:
        """Read the angles if those that are known are old. Raises NoAnswerError."""
        began = self._transport.now()
        if self._chain.is_lost() and not isinstance(reason := self._poll(), Reading):
            raise self._no_answer(f"angles ({reason})", began)

    def _stop_turning(self) -> None:
        """Stop both axes after a command that only one of them may have taken; what fails is left to the watchdog."""
        with suppress(PtuError, ExchangeFailed):
            self._halt_both()

    def _halt_both(self) -> None:
        self._command("H")
        self._stand()

    def _setup(self) -> tuple[str, ...]:
        """Return what a unit has to be told after echo and terse answers."""
        return ("CI", *(f"{LETTER[axis]}S{rate}" for axis, rate in self._rates.items()))

    def halt(self) -> None:
        """Stop both axes now."""
        with self._lock.for_halt():
            self._begin()
            self._counter.halt_owed = True
            fault: PtuError | None = None
            began = self._transport.now()
            if not self._is_ready():
                # first without a question: it may be heard though no answer comes
                with suppress(LineError):
                    self._line.halt_blind()
            for _ in range(_HALTS):
                self._begin()
                if not self._is_ready():
                    self._counter.halt_owed = True
                    self._advance()
                    if not self._counter.halt_owed:
                        break
                    if not self._is_ready():
                        fault = self._no_answer("H", began)
                        continue
                try:
                    with self._answered("H"):
                        self._command("H")
                except RefusedError:
                    raise
                except PtuError as raised:
                    fault = raised
                    continue
                break
            else:
                raise fault or self._no_answer("H", began)
            self._counter.halt_owed = False
            self._stand()

    def home(self) -> None:
        """Reset and home the unit."""
        with self._lock:
            self._begin()
            self._must_be_ready()
            self._counter.state = UnitState.STARTING
            began = self._transport.now()
            try:
                self._line.outwait("R", self._settings.homing_timeout_s)
            except ExchangeFailed as failure:
                self._recovery.record_failure(failure.reason)
                raise NoAnswerError("R", waited_s=self._transport.now() - began, got=failure.got) from failure
            except LineError:
                self._recovery.record_failure(FailureReason.LINE_LOST)
                raise
            self._poller.forget()
            self._stand()
            self._counter.state = UnitState.READY

    def close(self) -> None:
        """Halt and let go of the line."""
        with self._lock.for_halt():
            if self._counter.state is UnitState.CLOSED:
                return
            if self._watchdog is not None:
                self._watchdog.stop()
            try:
                self.halt()
                self._begin()
                for axis, rate in self._rates.items():
                    self._chain.set_speed(axis, rate)
            except (PtuError, ExchangeFailed):
                # the line is dead: once more blindly, it may carry one way
                with suppress(PtuError):
                    self._transport.write(b"Z H ")
            finally:
                self._counter.state = UnitState.CLOSED
                self._transport.close()

    def _watch(self) -> None:
        """Supervise motion by rate: the command timeout and the limits."""
        with self._lock:
            if self._counter.state is UnitState.CLOSED or not any(self._turning.values()):
                return
            if self._transport.now() - self._counter.last_reading_s > _WATCH_S:
                self.read()

    def _guard(self, reading: Reading) -> None:
        """Stop an axis that turns by rate before it passes its limit."""
        for axis, rate in self._turning.items():
            if rate and self._convert.outward(axis, reading, rate):
                self._chain.halt(axis)
                self._turning[axis] = 0.0

    def _command(self, command: str) -> None:
        """Carry out a command. Raises RefusedError, ExchangeFailed, LineError."""
        try:
            answer = self._line.query(command, deadline_s=self._until_s).answer
        except ExchangeFailed as failure:
            self._recovery.record_failure(failure.reason)
            self._counter.halt_owed = True
            raise
        except LineError:
            self._recovery.record_failure(FailureReason.LINE_LOST)
            raise
        if not answer.ok:
            raise RefusedError(command, said=answer.text)

    @contextmanager
    def _answered(self, what: str) -> Iterator[None]:
        """Convert a failed exchange of a user's command into NoAnswerError."""
        began = self._transport.now()
        try:
            yield
        except ExchangeFailed as failure:
            raise NoAnswerError(what, waited_s=self._transport.now() - began, got=failure.got) from failure

    def _is_ready(self) -> bool:
        return self._counter.state is UnitState.READY

    def _begin(self) -> None:
        """Begin a call: the unit must be open, and the call has its time from now on."""
        if self._counter.state is UnitState.CLOSED:
            raise LineError(self._transport.url, got="a closed unit", wanted="an open one")
        self._until_s = self._transport.now() + self._limit_s

    def _must_be_ready(self) -> None:
        """Give a line that is not ready one recovery step. Raises NoAnswerError."""
        began = self._transport.now()
        if not self._is_ready():
            self._advance()
        if not self._is_ready():
            raise self._no_answer("a command", began)

    def _no_answer(self, command: str, began_s: float) -> NoAnswerError:
        return NoAnswerError(command, waited_s=self._transport.now() - began_s, got=f"state: {self._counter.state}")
