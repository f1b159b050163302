"""FLIR / Directed Perception pan-tilt units over their ASCII protocol: the driver."""

import math
from collections.abc import Callable
from contextlib import suppress

from ptu_drivers.errors import LineError, NoAnswerError, RefusedError
from ptu_drivers.exchange_failed import ExchangeFailed, reason_of
from ptu_drivers.flir.description import describe_unit
from ptu_drivers.flir.line import LONGEST_ANSWER_CHARACTERS, FlirLine
from ptu_drivers.flir.poll import Poller, Query
from ptu_drivers.flir.probe import LETTER, UnitFacts
from ptu_drivers.flir.rate_chain import RateChain
from ptu_drivers.flir.recovery import DEFAULT_BAUD, Recovery
from ptu_drivers.flir.unit_conversion import Converter
from ptu_drivers.health import FailureReason, HealthCounter, UnitState
from ptu_drivers.line_lock import PreemptibleLine
from ptu_drivers.messages import Axis, Reading
from ptu_drivers.polled_unit import PolledUnit
from ptu_drivers.settings import UnitSettings
from ptu_drivers.transport import BITS_PER_CHARACTER

# the line is emptied for so long at most before the question is repeated
DRAINING_S = 0.25
# commands of one call, which a unit that takes ten a second keeps apart: three times both angles, where nothing is yet
# known of them, speed and target of both axes
_COMMANDS = 10


class FlirUnit(PolledUnit):
    """A FLIR unit, probed; made by `open_flir` or `connect`."""

    # `_check_room` has read before, because a target is ahead of the axis
    _stale_s = math.inf

    def __init__(
        self,
        line: PreemptibleLine,
        exchange: FlirLine,
        settings: UnitSettings,
        facts: UnitFacts,
        health: HealthCounter,
        *,
        watch: bool,
    ) -> None:
        slowest = min(DEFAULT_BAUD, line.baud() or DEFAULT_BAUD)
        limit_s = settings.reply_timeout_s + DRAINING_S + _COMMANDS * facts.pace_s
        limit_s += LONGEST_ANSWER_CHARACTERS * BITS_PER_CHARACTER / slowest
        description = describe_unit(facts, line, settings, limit_s)
        super().__init__(line, settings, description, health, watch=watch)
        self._exchange = exchange
        self._convert = Converter(facts=facts, description=description, settings=settings)
        self._poller = Poller(exchange, facts, self._convert, settings)
        self._recovery = Recovery(exchange, health, self._setup)
        self._speeds = {axis: facts.axis(axis).rate for axis in Axis}
        """Of moves to positions, counts/s."""
        self._chain = RateChain(self._convert, self._tell, line.now)
        self._moving = False
        """Something was commanded since the unit was last halted or restarted."""

    def use_query(self, query: Query, *, type_ahead: bool = True) -> None:
        """Use this query for angles from now on, whatever the probe selected."""
        self._poller.query = query
        self._poller.type_ahead = type_ahead
        self._poller.forget()

    def home(self) -> None:
        """Reset and home the unit."""
        with self._lock:
            self._begin()
            self._make_ready("home")
            self._health.state = UnitState.STARTING
            began = self._line.now()
            try:
                self._exchange.outwait("R", self._settings.homing_timeout_s)
            except (ExchangeFailed, LineError) as fault:
                self._note_failure(fault)
                if isinstance(fault, LineError):
                    raise
                raise NoAnswerError("home", waited_s=self._line.now() - began, got=fault.got) from fault
            self._poller.forget()
            self._stand()
            self._health.state = UnitState.READY

    def _query(self) -> Reading:
        reading = self._poller.poll(self._until_s)
        self._chain.observe(reading)
        self._recovery.note_answer()
        return reading

    def _send_position(self, targets: dict[Axis, float], rate_rad_s: float | None) -> None:
        self._moving = self._moving or bool(targets)
        for axis in targets:
            speed = self._speeds[axis] if rate_rad_s is None else abs(self._convert.rate(axis, rate_rad_s))
            self._chain.set_speed(axis, speed)
            self._speeds[axis] = speed
        self._chain.go({axis: self._convert.position(axis, unit_rad) for axis, unit_rad in targets.items()})

    def _send_rates(self, rates: dict[Axis, float]) -> None:
        self._moving = True
        self._chain.turn({axis: self._convert.rate(axis, rate) for axis, rate in rates.items()})
        # on a slow line the commands have taken a part of the watchdog's time
        self._turning.commanded_s = self._line.now()

    def _send_halt(self) -> None:
        try:
            self._tell("H")
        except LineError as fault:
            # the line may be back within the time of a halt, which is tried again
            raise ExchangeFailed(FailureReason.LINE_LOST, str(fault)) from fault
        self._stand()

    def _tell(self, command: str) -> None:
        """Carry out a command. Raises RefusedError, ExchangeFailed, LineError."""
        answer = self._exchange.query(command, deadline_s=self._until_s).answer
        if not answer.ok:
            raise RefusedError(command, reported=answer.text)

    def _stand(self) -> None:
        """Both axes were halted, or restarted: no motion is left."""
        self._moving = False
        self._turning.end()
        self._chain.stand()

    def _recover(self) -> FailureReason:
        """Take one bounded step; there are angles in the next call at the earliest."""
        if self._health.state is UnitState.LINE_LOST and self._moving:
            # earlier motion continues meanwhile
            self._health.halt_owed = True
            self._turning.end()
        owed = self._health.halt_owed
        reason = self._recovery.advance(self._until_s)
        if self._recovery.restarted:
            self._recovery.restarted = False
            self._poller.forget()
            self._stand()
            self._chain.stand(self._speeds)
        elif owed and not self._health.halt_owed:
            self._stand()
        return reason

    def _recover_to_halt(self) -> FailureReason | None:
        """Take one step, which halts the unit as soon as it replies."""
        if self._health.is_ready():
            return None
        reason = self._recover()
        return None if self._health.is_ready() else reason

    def _note_failure(self, fault: ExchangeFailed | LineError) -> FailureReason:
        reason = reason_of(fault)
        self._recovery.record_failure(reason)
        return reason

    def _setup(self) -> tuple[str, ...]:
        """Return the settings to restore after echo and terse replies."""
        return ("CI", *(f"{LETTER[axis]}S{speed}" for axis, speed in self._speeds.items()))

    def _halt_blind(self) -> None:
        with suppress(LineError):
            self._exchange.halt_blind()

    def _release(self) -> None:
        """Give the speeds of moves back."""

        def give_back() -> None:
            for axis, speed in self._speeds.items():
                self._chain.set_speed(axis, speed)

        self._attempt(give_back)

    def _keep_motion(self) -> FailureReason | None:
        """Halt motion by rate that no command renews; otherwise renew it."""
        if not self._health.is_ready() or not self._turning.turns():
            return None
        if not self._turning.is_overdue(self._line.now(), self._settings.watchdog_s):
            return self._drive(self._chain.renew)
        self._health.watchdog_stops += 1
        return self._drive(self._send_halt)

    def _check_room(self, asked: dict[Axis, float]) -> None:
        self._make_ready("turn")
        if any(asked.values()) and self._chain.is_lost():
            began = self._line.now()
            if not isinstance(reason := self._ask(), Reading):
                got = f"state: {self._health.state}"
                raise NoAnswerError(f"angles ({reason})", waited_s=self._line.now() - began, got=got)
        if self._last is not None:
            for axis, rate in self._turning.from_rest(asked).items():
                if limit := self._convert.outward(axis, self._last, rate):
                    raise limit

    def _stop_at_limits(self, reading: Reading) -> FailureReason | None:
        """Stop an axis that turns by rate before it passes its limit; the other one turns on."""
        rates = self._turning.rates or {}
        near = [axis for axis, rate in rates.items() if rate and self._convert.outward(axis, reading, rate)]
        return self._drive(lambda: self._stop(near)) if near else None

    def _stop(self, axes: list[Axis]) -> None:
        for axis in axes:
            self._chain.halt(axis)
            self._turning.stop(axis)

    def _drive(self, send: Callable[[], None]) -> FailureReason | None:
        """Carry out commands of the driver's own; return why that could not be done."""
        try:
            fault = self._attempt(send)
        except RefusedError:
            return FailureReason.REFUSED
        return reason_of(fault) if fault else None

    def _note_refusal(self) -> None:
        """Stop both axes at once where one may have accepted a rate; a position ends without a command."""
        if self._turning.turns():
            self._try_halt()
