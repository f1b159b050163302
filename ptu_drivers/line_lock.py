"""Priority of a halt: it takes a unit's line next, and another thread's exchange there is aborted."""

import threading
from types import TracebackType
from typing import Protocol, Self

from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason
from ptu_drivers.transport import Chunk, Transport

# interval at which an exchange checks whether a halt waits for its line
SLICE_S = 0.02


class LineLock:
    """The lock of a line; re-entrant, a context manager.

    A halt (`for_halt`) is admitted before all other waiting threads, and `is_preempted` requests the current exchange
    to abort. A halt itself is not preempted by another one.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._owner = 0
        self._depth = 0
        self._owner_halts = False
        self._halts_waiting = 0

    @property
    def is_preempted(self) -> bool:
        """Return whether the current exchange is to be aborted."""
        return self._halts_waiting > 0 and not self._owner_halts

    def for_halt(self) -> "_Halting":
        """Return a context manager that takes the line for a halt."""
        return _Halting(self)

    def raise_if_preempted(self) -> None:
        """Return if the current exchange may continue. Raises ExchangeFailed."""
        if self.is_preempted:
            raise ExchangeFailed(FailureReason.PREEMPTED, "a halt from another thread")

    def acquire(self, *, halts: bool = False) -> None:
        """Wait for the line."""
        me = threading.get_ident()
        with self._changed:
            if self._owner == me:
                self._depth += 1
                return
            if halts:
                self._halts_waiting += 1
                try:
                    self._changed.wait_for(lambda: self._owner == 0)
                finally:
                    self._halts_waiting -= 1
            else:
                self._changed.wait_for(lambda: self._owner == 0 and self._halts_waiting == 0)
            self._owner, self._depth, self._owner_halts = me, 1, halts

    def release(self) -> None:
        """Give it back."""
        with self._changed:
            self._depth -= 1
            if self._depth == 0:
                self._owner, self._owner_halts = 0, False
                self._changed.notify_all()

    def __enter__(self) -> Self:
        self.acquire()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()


class _Halting:
    """The lock, taken for a halt."""

    def __init__(self, lock: LineLock) -> None:
        self._lock = lock

    def __enter__(self) -> None:
        self._lock.acquire(halts=True)

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()


class LockedLine(Protocol):
    """The interface of a line for a unit's life cycle: a `PreemptibleLine`, or a connection of another kind."""

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


class PreemptibleLine:
    """A `Transport` whose reads are aborted when a halt waits for the line; all else is the transport's own.

    Parameters
    ----------
    transport : the line itself; owned by this object.
    """

    def __init__(self, transport: Transport) -> None:
        self.url = transport.url
        self.lock = LineLock()
        self._transport = transport

    def read(self, until_s: float) -> Chunk:
        """Return available data, or wait for them. Raises LineError; ExchangeFailed when a halt waits."""
        while True:
            self.lock.raise_if_preempted()
            chunk = self._transport.read(min(until_s, self._transport.now() + SLICE_S))
            if chunk.data or self._transport.now() >= until_s:
                return chunk

    def now(self) -> float:
        """Return the clock, s."""
        return self._transport.now()

    def wait(self, duration_s: float) -> None:
        """Let time pass."""
        self._transport.wait(duration_s)

    def character_s(self) -> float:
        """Return what one character takes on the line, s."""
        return self._transport.character_s()

    def send_sigma_s(self) -> float:
        """Return the spread of the delay between `write` and the line, s."""
        return self._transport.send_sigma_s()

    def set_baud(self, baud: int) -> bool:
        """Change the speed of the host's end. Raises LineError."""
        return self._transport.set_baud(baud)

    def baud(self) -> int:
        """Return the speed of the host's end, bit/s."""
        return self._transport.baud()

    def write(self, data: bytes) -> float:
        """Send all of it; return when the last byte was handed over, s. Raises LineError."""
        return self._transport.write(data)

    def reopen(self) -> None:
        """Close and open again. Raises LineError."""
        self._transport.reopen()

    def close(self) -> None:
        """Let go of the line."""
        self._transport.close()
