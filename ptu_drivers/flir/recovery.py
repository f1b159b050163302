"""From a failure back to angles, one bounded step at a time: the line, the echo, the speed, the unit's settings."""

from collections import deque
from collections.abc import Callable

from ptu_drivers.errors import LineError, ProtocolError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.flir.codec import integer
from ptu_drivers.flir.line import FlirLine
from ptu_drivers.health import FailureReason, HealthCounter, UnitState

# a unit's speed at power-up, as it leaves the factory
DEFAULT_BAUD = 9600
_REOPEN_AFTER = 4
_IDLE_S = 0.02
_RESYNCHRONISE = ""
# no unit boots and homes faster
_BOOT_S = 1.0
# then the question is repeated: power may have been lost meanwhile, and the question with it
_AWAIT_S = 2.0


class Recovery:
    """The recovery steps when the line or the unit is in an uncertain state.

    Parameters
    ----------
    line : the line. counter : its `state` is set here; while its `halt_owed` is set, the unit is halted as soon as
        it replies, because unknown motion may continue.
    setup : commands that restore the settings of a restarted unit, after echo and terse replies.
    """

    def __init__(self, line: FlirLine, counter: HealthCounter, setup: Callable[[], tuple[str, ...]]) -> None:
        self.restarted = False
        """The unit was found restarted since this was last cleared."""
        self._line = line
        self._counter = counter
        self._setup = setup
        self._baud = line.transport.baud()
        self._failed = 0
        self._answered_s = line.transport.now()
        self._queue: deque[str] = deque()
        self._awaited: Callable[[float], bool] | None = None
        self._await_until_s = 0.0

    def note_answer(self) -> None:
        """Everything is well."""
        self._answered_s = self._line.transport.now()

    def record_failure(self, reason: FailureReason) -> None:
        """Record a failure; the next `advance` starts the recovery."""
        self._counter.failures[reason] += 1
        self._awaited = None
        if reason is FailureReason.LINE_LOST:
            self._counter.state = UnitState.LINE_LOST
        elif self._counter.state is not UnitState.LINE_LOST:
            self._counter.state = UnitState.RESYNCHRONISING

    def advance(self, deadline_s: float) -> FailureReason:
        """Take one step, until `deadline_s` at most; return why there is no angle yet."""
        try:
            if self._counter.state is UnitState.LINE_LOST:
                self._reopen()
                return FailureReason.LINE_LOST
            if self._counter.state is UnitState.STARTING:
                self._start(deadline_s)
                return FailureReason.STARTING
            self._resynchronise(deadline_s)
        except ExchangeFailed as failure:
            if failure.reason is FailureReason.PREEMPTED:
                # independent of the line
                self.record_failure(failure.reason)
            else:
                self._fail(failure.reason)
            return failure.reason
        except LineError:
            self.record_failure(FailureReason.LINE_LOST)
            self._line.transport.wait(_IDLE_S)
            return FailureReason.LINE_LOST
        return FailureReason.STARTING if self._queue else FailureReason.TIMEOUT

    def _resynchronise(self, deadline_s: float) -> None:
        self._counter.resyncs += 1
        line = self._line
        if self._failed:
            line.greet(deadline_s)
        else:
            line.resynchronise(deadline_s)
        self._look_for_restart(deadline_s)
        if not self._queue:
            self._halt_if_owed(deadline_s)
        self._failed = 0
        if line.transport.baud() != self._baud:
            # it replies at another speed than the set one
            self._restart()
        self._counter.state = UnitState.STARTING if self._queue else UnitState.READY

    def _halt_if_owed(self, deadline_s: float) -> None:
        if self._counter.halt_owed:
            self._counter.halt_owed = not self._line.query("H", deadline_s=deadline_s).answer.ok

    def _look_for_restart(self, deadline_s: float) -> None:
        """Detect a restart, after which a unit has verbose replies again."""
        reported = self._line.query("PP", deadline_s=deadline_s).answer
        try:
            integer(reported.text)
        except ProtocolError as fault:
            if not reported.ok or "position" not in reported.text:
                raise ExchangeFailed(FailureReason.GARBAGE, reported.text) from fault
            if self._line.transport.now() - self._answered_s > _BOOT_S:
                self._restart()
            else:
                # no time to boot: the setting was changed by another program
                self._queue = deque(("EE", "FT"))

    def _restart(self) -> None:
        """Repeat the whole set-up, after homing."""
        if not self._queue:
            self._counter.restarts += 1
        self.restarted = True
        self._counter.halt_owed = False
        baud = (f"@({self._baud},0,F)", _RESYNCHRONISE) if self._baud not in (0, self._line.transport.baud()) else ()
        # speeds of zero stop motion by rate, and are refused by a unit that homes or moves to a position
        self._queue = deque(("EE", "FT", "PS0", "TS0", "A", *self._setup(), *baud))

    def _start(self, deadline_s: float) -> None:
        line = self._line
        if not self._queue:
            self._halt_if_owed(deadline_s)
            self._counter.state = UnitState.READY
            return
        command = self._queue[0]
        if command == "A":
            if self._awaited is None:
                self._awaited = line.begin("A")
                self._await_until_s = line.transport.now() + _AWAIT_S
            elif line.transport.now() > self._await_until_s:
                raise ExchangeFailed(FailureReason.TIMEOUT, "nothing to A")
            if not self._awaited(deadline_s):
                return
            self._awaited = None
        elif command == _RESYNCHRONISE:
            line.resynchronise(deadline_s)
        else:
            line.query(command, deadline_s=deadline_s)
            if command.startswith("@"):
                line.transport.set_baud(self._baud)
        self._queue.popleft()

    def _fail(self, reason: FailureReason) -> None:
        self.record_failure(reason)
        self._failed += 1
        transport = self._line.transport
        if self._failed % _REOPEN_AFTER == 0:
            self._counter.state = UnitState.LINE_LOST
        elif self._baud not in (0, DEFAULT_BAUD):
            other = DEFAULT_BAUD if transport.baud() == self._baud else self._baud
            transport.set_baud(other)

    def _reopen(self) -> None:
        transport = self._line.transport
        try:
            transport.reopen()
        except LineError:
            self._counter.failures[FailureReason.LINE_LOST] += 1
            transport.wait(_IDLE_S)
            return
        self._counter.reconnects += 1
        self._counter.state = UnitState.RESYNCHRONISING
