"""Failures so far, counted by reason."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType


class UnitState(StrEnum):
    """States of the driver."""

    READY = "ready"
    RESYNCHRONISING = "resynchronising"
    """Something doubtful came: the line is drained and asked a question whose answer cannot be confused."""
    STARTING = "starting"
    """The unit answers, but it was reset or power-cycled and homes, or its settings have to be set again."""
    LINE_LOST = "line lost"
    """The line is closed or without answers; it is opened again until it works."""
    CLOSED = "closed"


class FailureReason(StrEnum):
    """Reasons why a reply, or its absence, gave no angle."""

    TIMEOUT = "timeout"
    TRUNCATED = "truncated"
    """An answer began and did not end."""
    GARBAGE = "garbage"
    """Bytes that are no message of the protocol."""
    CHECKSUM = "checksum"
    ECHO_MISMATCH = "echo mismatch"
    """The answer is for another question: it came late, or replies are shifted by one."""
    UNEXPECTED = "unexpected line"
    """An unsolicited line: banner, leftover, joystick text."""
    REFUSED = "refused"
    """The unit answered a query with an error."""
    OUT_OF_RANGE = "out of range"
    """A number where the unit cannot be."""
    TOO_FAST = "too fast"
    """Further from the last angle than the unit can have turned since."""
    UNCONFIRMED = "unconfirmed"
    """Not where it was expected, and the repeated answer does not fit either."""
    STARTING = "starting"
    """The unit was reset or power-cycled; its angles count from nowhere until it has homed."""
    PREEMPTED = "preempted"
    """Given up before its end: another thread asked for a halt, which goes first."""
    LINE_LOST = "line lost"
    CLOSED = "closed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """Counts since the driver was opened; a snapshot.

    Attributes
    ----------
    state : of the driver.
    exchanges : commands and queries sent.
    readings : accepted angles, both axes.
    failures : replies discarded, by reason; a reason that is absent did not occur.
    limit_events : the unit's messages that an axis hit its limit.
    resyncs, reconnects, restarts : counts of resynchronisations, of reopenings of the line, and of the unit's restarts.
    watchdog_stops : motion halted because commands stopped.
    last_reading_s : instant of the newest accepted angle, s, or minus infinity.
    halt_owed : a halt by the user or after a failed command is not acknowledged: the unit may move. It is also valid
        after `close`, which does not raise: the unit is known to have been halted only where it is false.
    """

    state: UnitState
    exchanges: int
    readings: int
    failures: Mapping[FailureReason, int]
    limit_events: int
    resyncs: int
    reconnects: int
    restarts: int
    watchdog_stops: int
    last_reading_s: float
    halt_owed: bool = False


@dataclass(slots=True, kw_only=True)
class HealthCounter:
    """The same while it is counted; owned by one device, under its lock."""

    state: UnitState = UnitState.STARTING
    exchanges: int = 0
    readings: int = 0
    failures: Counter[FailureReason] = field(default_factory=Counter)
    limit_events: int = 0
    resyncs: int = 0
    reconnects: int = 0
    restarts: int = 0
    watchdog_stops: int = 0
    last_reading_s: float = float("-inf")
    halt_owed: bool = False

    def is_ready(self) -> bool:
        """Return whether the unit can be asked at once."""
        return self.state is UnitState.READY

    def snapshot(self) -> Health:
        """Return the counts until now."""
        return Health(
            state=self.state,
            exchanges=self.exchanges,
            readings=self.readings,
            failures=MappingProxyType(dict(self.failures)),
            limit_events=self.limit_events,
            resyncs=self.resyncs,
            reconnects=self.reconnects,
            restarts=self.restarts,
            watchdog_stops=self.watchdog_stops,
            last_reading_s=self.last_reading_s,
            halt_owed=self.halt_owed,
        )
