"""FLIR / Directed Perception pan-tilt units over their ASCII protocol: the device."""

import threading
from contextlib import suppress

from ptu_drivers.doubtful import Doubtful
from ptu_drivers.errors import LineError, NoAnswerError, PtuError, RefusedError
from ptu_drivers.flir_line import LONGEST_ANSWER_CHARACTERS, FlirLine
from ptu_drivers.flir_motion import Converter
from ptu_drivers.flir_poll import Poller, Query
from ptu_drivers.flir_probe import LETTER, UnitFacts
from ptu_drivers.flir_recovery import DEFAULT_BAUD, Recovery
from ptu_drivers.halting import Watchdog
from ptu_drivers.health import DoubtReason, Health, HealthCounter, UnitState
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.messages import Axis, Capability, NoReading, Reading, UnitDescription
from ptu_drivers.settings import UnitSettings
from ptu_drivers.transport import BITS_PER_CHARACTER

# the line is emptied for so long at most before it is asked anew
DRAINING_S = 0.25
_HALTS = 3
_WATCH_S = 0.1


class FlirUnit(PanTiltUnit):
    """A probed unit; made by `open_flir` or `connect`."""

    def __init__(
        self, line: FlirLine, counter: HealthCounter, facts: UnitFacts, settings: UnitSettings, *, threaded: bool
    ) -> None:
        self._lock = threading.RLock()
        self._line = line
        self._transport = line.transport
        self._counter = counter
        self._facts = facts
        self._settings = settings
        slowest = min(DEFAULT_BAUD, self._transport.baud() or DEFAULT_BAUD)
        self._limit_s = settings.reply_timeout_s + DRAINING_S + facts.pace_s
        self._limit_s += LONGEST_ANSWER_CHARACTERS * BITS_PER_CHARACTER / slowest
        self._description = self._describe()
        self._convert = Converter(facts=facts, description=self._description, settings=settings)
        self._poller = Poller(line, facts, self._convert, settings)
        self._recovery = Recovery(line, counter, self._setup)
        self._rates = {axis: facts.axis(axis).rate for axis in Axis}
        self._turning: dict[Axis, float] = {}
        self._moving = False
        self._commanded_s = self._transport.now()
        self._last: Reading | None = None
        self._watchdog: Watchdog | None = None
        self._threaded = threaded
        counter.state = UnitState.READY

    def ask_by(self, query: Query, *, type_ahead: bool = True) -> None:
        """Ask angles in this way from now on, whatever the probe found best."""
        self._poller.query = query
        self._poller.type_ahead = type_ahead
        self._poller.forget()

    def _describe(self) -> UnitDescription:
        facts, settings = self._facts, self._settings
        can = {Capability.POSITION, Capability.VELOCITY, Capability.SPEED, Capability.HOMING}
        can |= {Capability.COMBINED_QUERY} if facts.combined else set()
        can |= {Capability.DEVICE_CLOCK} if facts.clock_hz else set()
        baud, asked = self._transport.baud(), settings.baud
        kept = f"{baud}; the unit did not follow to {asked}" if asked and baud != asked else str(baud)
        return UnitDescription(
            protocol="flir",
            url=self._transport.url,
            model=facts.model,
            firmware=facts.firmware,
            serial=facts.serial,
            pan=facts.pan.describe(settings.pan),
            tilt=facts.tilt.describe(settings.tilt),
            capabilities=frozenset(can),
            reply_timeout_s=self._limit_s,
            details={**facts.details, "baud": kept if baud else "network"},
        )

    def describe(self) -> UnitDescription:
        """Return what the probe found."""
        return self._description

    def health(self) -> Health:
        """Return the counts until now."""
        return self._counter.snapshot()

    def read(self) -> Reading | NoReading:
        """Ask both axes where they are."""
        with self._lock:
            self._must_be_open()
            deadline = self._transport.now() + self._limit_s
            if self._counter.state is UnitState.READY:
                reason = self._watch_commands(deadline) or self._poll(deadline)
                if isinstance(reason, Reading):
                    return reason
            else:
                reason = self._advance(deadline)
            return NoReading(reason=reason, state=self._counter.state, t_s=self._transport.now())

    def _poll(self, deadline_s: float) -> Reading | DoubtReason:
        try:
            reading = self._poller.poll(deadline_s)
            self._guard(reading, deadline_s)
        except Doubtful as doubt:
            self._recovery.doubt(doubt.reason)
            return doubt.reason
        except LineError:
            self._lose_line()
            return DoubtReason.LINE_LOST
        self._last = reading
        self._recovery.note_answer()
        self._counter.readings += 1
        self._counter.last_reading_s = max(reading.pan.t_s, reading.tilt.t_s)
        return reading

    def _advance(self, deadline_s: float) -> DoubtReason:
        before = self._counter.state
        if before is UnitState.LINE_LOST and self._moving:
            self._recovery.halt_pending = True
        reason = self._recovery.advance(deadline_s)
        if self._counter.state is UnitState.LINE_LOST and self._moving:
            self._recovery.halt_pending = True
        if self._recovery.restarted:
            self._recovery.restarted = False
            self._moving = False
            self._turning.clear()
            self._poller.forget()
        return reason

    def _lose_line(self) -> None:
        self._recovery.halt_pending |= self._moving
        self._recovery.doubt(DoubtReason.LINE_LOST)

    def move_to(
        self, *, pan_rad: float | None = None, tilt_rad: float | None = None, rate_rad_s: float | None = None
    ) -> None:
        """Start to turn to a position."""
        with self._lock:
            self._must_be_open()
            wanted = {a: v for a, v in zip(Axis, (pan_rad, tilt_rad), strict=True) if v is not None}
            counts = {axis: self._convert.position(axis, angle) for axis, angle in wanted.items()}
            rates = dict(self._rates)
            if rate_rad_s is not None:
                rates |= {axis: abs(self._convert.rate(axis, rate_rad_s, still=False)) for axis in wanted}
            self._must_be_ready()
            self._leave_rates()
            for axis in wanted:
                if rates[axis] != self._rates[axis]:
                    self._command(f"{LETTER[axis]}S{rates[axis]}")
                    self._rates[axis] = rates[axis]
            self._moving = self._moving or bool(counts)
            for axis, position in counts.items():
                self._command(f"{LETTER[axis]}P{position}")
            self._commanded_s = self._transport.now()

    def move_at(self, *, pan_rad_s: float, tilt_rad_s: float) -> None:
        """Turn at a rate until the next command."""
        with self._lock:
            self._must_be_open()
            wanted = dict(zip(Axis, (pan_rad_s, tilt_rad_s), strict=True))
            counts = {axis: self._convert.rate(axis, rate) for axis, rate in wanted.items()}
            self._must_be_ready()
            if self._last is not None:
                for axis, rate in wanted.items():
                    if self._turning.get(axis, 0.0) == 0.0 and (limit := self._convert.outward(axis, self._last, rate)):
                        raise limit
            if not self._turning:
                self._command("CV")
            self._turning = dict(wanted)
            self._moving = True
            self._commanded_s = self._transport.now()
            # before anything turns: one axis may turn though the other one's command fails
            if self._threaded and self._watchdog is None:
                self._watchdog = Watchdog(self._watch, _WATCH_S)
            try:
                for axis, rate in counts.items():
                    self._command(f"{LETTER[axis]}S{rate}")
            except RefusedError:
                self._stop_turning()
                raise
            self._commanded_s = self._transport.now()

    def _stop_turning(self) -> None:
        """Stop both axes after a command that only one of them may have taken; what fails is left to the watchdog."""
        try:
            for letter in LETTER.values():
                self._command(f"{letter}S0")
        except PtuError:
            return
        self._turning = dict.fromkeys(Axis, 0.0)
        self._moving = False

    def _leave_rates(self) -> None:
        """Come to rest, and back to control by position."""
        if not self._turning:
            return
        for command in ("PS0", "TS0", "CI"):
            self._command(command)
        self._turning = {}
        for command in self._setup()[1:]:
            self._command(command)

    def _setup(self) -> tuple[str, ...]:
        """Return what a unit has to be told after echo and terse answers."""
        return ("CI", *(f"{LETTER[axis]}S{rate}" for axis, rate in self._rates.items()))

    def halt(self) -> None:
        """Stop both axes now."""
        with self._lock:
            self._must_be_open()
            fault: PtuError | None = None
            began = self._transport.now()
            for _ in range(_HALTS):
                if self._counter.state is not UnitState.READY:
                    self._recovery.halt_pending = True
                    self._advance(self._transport.now() + self._limit_s)
                    if not self._recovery.halt_pending:
                        break
                    if not self._is_ready():
                        fault = self._nothing("H", began)
                        continue
                try:
                    for command in ("H", "PS0", "TS0") if self._turning else ("H",):
                        self._command(command)
                except RefusedError:
                    raise
                except PtuError as raised:
                    fault = raised
                    continue
                break
            else:
                self._recovery.halt_pending = True
                raise fault or self._nothing("H", began)
            self._recovery.halt_pending = False
            self._moving = False
            if self._turning:
                self._turning = dict.fromkeys(Axis, 0.0)

    def home(self) -> None:
        """Reset and home the unit."""
        with self._lock:
            self._must_be_open()
            self._must_be_ready()
            self._leave_rates()
            self._counter.state = UnitState.STARTING
            began = self._transport.now()
            try:
                answered = self._line.begin("R")
                while not answered(self._transport.now() + self._limit_s):
                    if self._transport.now() - began > self._settings.homing_timeout_s:
                        raise Doubtful(DoubtReason.TIMEOUT, "nothing")
            except Doubtful as doubt:
                self._recovery.doubt(doubt.reason)
                raise NoAnswerError("R", waited_s=self._transport.now() - began, got=doubt.got) from doubt
            except LineError:
                self._lose_line()
                raise
            self._poller.forget()
            self._moving = False
            self._counter.state = UnitState.READY

    def close(self) -> None:
        """Halt and let go of the line."""
        with self._lock:
            if self._counter.state is UnitState.CLOSED:
                return
            if self._watchdog is not None:
                self._watchdog.stop()
            try:
                self.halt()
                if self._turning:
                    self._leave_rates()
            except PtuError:
                # the line is dead: once more blindly, it may carry one way
                with suppress(PtuError):
                    self._transport.write(b"Z H ")
            finally:
                self._counter.state = UnitState.CLOSED
                self._transport.close()

    def _watch_commands(self, deadline_s: float) -> DoubtReason | None:
        """Halt if motion by rate goes on and no command came; return why that could not be done."""
        late = self._settings.watchdog_s and self._transport.now() - self._commanded_s > self._settings.watchdog_s
        if not late or not any(self._turning.values()):
            return None
        self._counter.watchdog_stops += 1
        try:
            for command in ("PS0", "TS0"):
                self._line.ask(command, deadline_s=deadline_s)
        except Doubtful as doubt:
            self._recovery.doubt(doubt.reason)
            self._recovery.halt_pending = True
            return doubt.reason
        except LineError:
            self._lose_line()
            return DoubtReason.LINE_LOST
        self._turning = dict.fromkeys(Axis, 0.0)
        self._moving = False
        return None

    def _watch(self) -> None:
        """Look after motion by rate: that commands come, that limits are kept."""
        with self._lock:
            if self._counter.state is UnitState.CLOSED or not any(self._turning.values()):
                return
            if self._transport.now() - self._counter.last_reading_s > _WATCH_S:
                self.read()

    def _guard(self, reading: Reading, deadline_s: float) -> None:
        """Stop an axis that turns by rate before it passes its limit."""
        for axis, rate in self._turning.items():
            if rate and self._convert.outward(axis, reading, rate):
                self._line.ask(f"{LETTER[axis]}S0", deadline_s=deadline_s)
                self._turning[axis] = 0.0

    def _command(self, command: str) -> None:
        """Carry out a command. Raises RefusedError, NoAnswerError, LineError."""
        began = self._transport.now()
        try:
            answer = self._line.ask(command).answer
        except Doubtful as doubt:
            self._recovery.doubt(doubt.reason)
            self._recovery.halt_pending = True
            raise NoAnswerError(command, waited_s=self._transport.now() - began, got=doubt.got) from doubt
        except LineError:
            self._lose_line()
            raise
        if not answer.ok:
            raise RefusedError(command, said=answer.text)

    def _is_ready(self) -> bool:
        return self._counter.state is UnitState.READY

    def _must_be_open(self) -> None:
        if self._counter.state is UnitState.CLOSED:
            raise LineError(self._transport.url, got="a closed unit", wanted="an open one")

    def _must_be_ready(self) -> None:
        """Give a line in doubt one step to come back. Raises NoAnswerError."""
        began = self._transport.now()
        if not self._is_ready():
            self._advance(began + self._limit_s)
        if not self._is_ready():
            raise self._nothing("a command", began)

    def _nothing(self, command: str, began_s: float) -> NoAnswerError:
        return NoAnswerError(command, waited_s=self._transport.now() - began_s, got=f"state: {self._counter.state}")
