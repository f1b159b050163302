"""The usual recovery from a failed exchange: replies are matched again, a line that stays silent is reopened."""

from ptu_drivers.errors import LineError
from ptu_drivers.exchange_failed import ExchangeFailed, reason_of
from ptu_drivers.health import FailureReason, HealthCounter, UnitState
from ptu_drivers.line_lock import LockedLine

# timeouts in a row after which the line is opened again: a socket can be half open, an adapter asleep
_SILENCES = 4
_REOPEN_S = 0.2


class Reconnection:
    """The recovery steps due after failures.

    Parameters
    ----------
    line : the line. health : its `state` is set here: ready, to be resynchronised, or lost.
    """

    def __init__(self, line: LockedLine, health: HealthCounter) -> None:
        self._line = line
        self._health = health
        self._silences = 0
        self._next_reopen_s = float("-inf")

    def note_answer(self) -> None:
        """Everything is well."""
        self._silences = 0
        self._health.state = UnitState.READY

    def note_failure(self, fault: ExchangeFailed | LineError) -> FailureReason:
        """Count a failed exchange and select the recovery; return its reason."""
        reason = reason_of(fault)
        if isinstance(fault, LineError):
            self._lose()
        else:
            silent = reason in (FailureReason.TIMEOUT, FailureReason.LINE_LOST)
            self._silences = self._silences + 1 if silent else 0
            if self._health.state is UnitState.READY:
                self._health.state = UnitState.RESYNCHRONISING
                self._health.resyncs += 1
            if self._silences >= _SILENCES and self._health.state is not UnitState.LINE_LOST:
                self._lose()
        self._health.failures[reason] += 1
        return reason

    def reopen(self, until_s: float) -> None:
        """Open the line again, a few times a second at most; waits until `until_s` at most. Raises LineError."""
        now = self._line.now()
        if now < self._next_reopen_s:
            self._line.wait(min(self._next_reopen_s, until_s) - now)
        self._next_reopen_s = self._line.now() + _REOPEN_S
        self._line.reopen()
        self._health.reconnects += 1
        self._health.state = UnitState.RESYNCHRONISING

    def _lose(self) -> None:
        self._silences = 0
        self._health.state = UnitState.LINE_LOST
