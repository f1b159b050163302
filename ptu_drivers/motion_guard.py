"""A process that halts units when the process that drives them stops renewing their leases.

A driver's own watchdog ends with its process. This one is a separate process: the driving process renews a lease for
each unit in shared memory; when a lease has expired, or on request, the unit is halted over a separate
connection (`emergency_halt`). It also reports that it is alive, so that no unit turns unguarded.
"""

import contextlib
import multiprocessing as mp
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from ptu_drivers.deferred_termination import ENDING, DeferredTermination
from ptu_drivers.emergency_halt import HaltLine, halt_once, prepared
from ptu_drivers.errors import PtuError

# A lease's length, and how long a process may be silent before nothing relies on it. A unit then stands within 1 s,
# half a second of braking included; renewals come every 0.05 s, so that a busy machine has seven chances.
LEASE_S = 0.35
_LOOK_S = 0.02
_AGAIN_S = 0.05
# time for which halts are repeated to a unit that does not acknowledge
HALTING_S = 2.0
# and for so long once no process is left that would renew it
_ORPHANED_S = 10.0
_BEATS = 2
_NICE = -10
# upper bound of a halt's memory, including a thread's stack
_RESERVE_BYTES = 16 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardReport:
    """Result of halting a unit: whether it acknowledged, begin and end, s, and the error if it failed."""

    name: str
    acknowledged: bool
    began_s: float
    ended_s: float
    why: str = ""


class MotionLeases:
    """Instants in memory shared by several processes, s on the machine's monotonic clock.

    It is passed to a process at its start. Each value has one writer; writing eight aligned bytes is atomic.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self._values: Any = mp.get_context("spawn").RawArray("d", _BEATS + len(self.names))

    @property
    def guard_heartbeat_s(self) -> float:
        """Time of the guard's last heartbeat; 0 before the first."""
        return float(self._values[0])

    @property
    def driver_heartbeat_s(self) -> float:
        """Time of the driving process's last heartbeat; 0 before the first."""
        return float(self._values[1])

    def set_guard_heartbeat(self, now_s: float) -> None:
        """Write the guard's heartbeat."""
        self._values[0] = now_s

    def set_driver_heartbeat(self, now_s: float) -> None:
        """Write the driving process's heartbeat."""
        self._values[1] = now_s

    def until_s(self, name: str) -> float:
        """Return when a unit's lease runs out; 0 where it has none."""
        return float(self._values[_BEATS + self.names.index(name)])

    def renew(self, name: str, until_s: float) -> None:
        """Renew a unit's lease until then."""
        self._values[_BEATS + self.names.index(name)] = until_s

    def release(self, name: str) -> None:
        """Release a unit's lease after its driver has halted it."""
        self._values[_BEATS + self.names.index(name)] = 0.0


class MemoryReserve:
    """Memory that is kept for a halt: given back to the system before one, so that it succeeds where there is no other.

    Without it a halt at the limit of the process's address space took up to 1.4 s (`benchmarks/live_kill.py`).
    """

    def __init__(self, size: int = _RESERVE_BYTES) -> None:
        self._size = size
        self._halts = 0
        self._changing = threading.Lock()
        self._held: bytearray | None = None
        self._take()

    @property
    def held(self) -> bool:
        """Whether the memory is kept."""
        return self._held is not None

    def release(self) -> None:
        """Give the memory back: a halt begins."""
        with self._changing:
            self._halts += 1
            self._held = None

    def hold(self) -> None:
        """Take the memory again, if there is enough, once the last halt under way has ended."""
        with self._changing:
            self._halts -= 1
            if not self._halts:
                self._take()

    def _take(self) -> None:
        with contextlib.suppress(MemoryError):
            self._held = bytearray(self._size)


class HaltingThread:
    """Halts one unit on request, in a separate thread: a line that hangs does not delay the others.

    Parameters
    ----------
    report : receives the result. attempt : one attempt, as `halt_once`; raises PtuError.
    find : prepares the line, once, before any request. reserve : memory for the halt.
    """

    def __init__(
        self,
        name: str,
        line: HaltLine,
        report: Callable[[GuardReport], None],
        *,
        attempt: Callable[[HaltLine, int], None] = halt_once,
        find: Callable[[HaltLine], HaltLine] = prepared,
        reserve: MemoryReserve | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._reserve = reserve
        self._name, self._line, self._report, self._attempt, self._clock = name, line, report, attempt, clock
        self._find = find
        self._asked = threading.Event()
        self._halting = False
        self._thread = threading.Thread(target=self._work, name=f"halt-{name}", daemon=True)
        self._thread.start()

    def request(self) -> None:
        """Request a halt that begins from now on; during a halt, another follows it."""
        self._asked.set()

    @property
    def busy(self) -> bool:
        """Whether a halt is asked for and has no result yet."""
        return self._asked.is_set() or self._halting

    def _work(self) -> None:
        self._line = self._find(self._line)
        while True:
            self._asked.wait()
            self._halting = True
            self._asked.clear()
            if self._reserve is not None:
                self._reserve.release()
            self._report(self._halt())
            self._halting = False
            if self._reserve is not None:
                self._reserve.hold()

    def _halt(self) -> GuardReport:
        began_s = self._clock()
        why, attempt = "", 0
        while attempt == 0 or self._clock() < began_s + HALTING_S:
            try:
                self._attempt(self._line, attempt)
            except PtuError as fault:
                why = str(fault)
            except Exception as fault:  # noqa: BLE001 - whatever it is: the next try may reach the unit
                why = f"{type(fault).__name__}: {fault}"
            else:
                return GuardReport(name=self._name, acknowledged=True, began_s=began_s, ended_s=self._clock())
            attempt += 1
            time.sleep(_AGAIN_S)
        return GuardReport(name=self._name, acknowledged=False, began_s=began_s, ended_s=self._clock(), why=why)


class ExpiredLeases:
    """Expired leases that were not handled yet.

    A lease counts as expired when it is so in two successive checks: after a pause of the whole machine,
    its holder has the time of one check to renew it.
    """

    def __init__(self, leases: MotionLeases) -> None:
        self._leases = leases
        self._suspected: dict[str, float] = {}
        self._handled: dict[str, float] = {}

    def expired(self, now_s: float) -> tuple[str, ...]:
        """Return the names of units whose lease has run out since they were last returned."""
        out = []
        for name in self._leases.names:
            until_s = self._leases.until_s(name)
            if not 0.0 < until_s < now_s or self._handled.get(name) == until_s:
                self._suspected.pop(name, None)
            elif self._suspected.get(name) == until_s:
                self._handled[name] = until_s
                out.append(name)
            else:
                self._suspected[name] = until_s
        return tuple(out)

    def pending(self) -> bool:
        """Return whether a lease is in force, or has run out and was not acted on."""
        values = {name: self._leases.until_s(name) for name in self._leases.names}
        return any(v > 0.0 and self._handled.get(name) != v for name, v in values.items())


def serve_guard(lines: Mapping[str, HaltLine], leases: MotionLeases, pipe: Connection) -> None:
    """Guard units until a stop message; after the pipe has closed, until each unit is halted or released.

    Messages in: "halt" for all units, "stop", `ENDING`. Messages out: `GuardReport`. A SIGTERM ends it only while the
    pipe is open, and where no `ENDING` comes (`DeferredTermination`).
    """
    termination = DeferredTermination()
    with termination.deferred():
        termination.install()
        _guard(lines, leases, pipe, termination)


def _guard(
    lines: Mapping[str, HaltLine], leases: MotionLeases, pipe: Connection, termination: DeferredTermination
) -> None:
    # it sleeps nearly always, and must not wait for a core when needed; only some users may request that
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
    sending = threading.Lock()

    def report(what: GuardReport) -> None:
        with sending, contextlib.suppress(OSError):
            pipe.send(what)

    reserve = MemoryReserve()
    halting = {name: HaltingThread(name, line, report, reserve=reserve) for name, line in lines.items()}
    expiry = ExpiredLeases(leases)
    orphaned_s: float | None = None
    while True:
        now_s = time.monotonic()
        leases.set_guard_heartbeat(now_s)
        for name in expiry.expired(now_s):
            halting[name].request()
        if orphaned_s is not None:
            done = not expiry.pending() and not any(h.busy for h in halting.values())
            if done or now_s > orphaned_s + _ORPHANED_S:
                return
            time.sleep(_LOOK_S)
            continue
        try:
            if pipe.poll(_LOOK_S):
                word = pipe.recv()
                if word == "stop":
                    return
                if word == ENDING:
                    termination.note_parent_ends()
                    continue
                for each in halting.values():
                    each.request()
            elif termination.is_due():
                # not before the pipe is empty: the announcement may wait in it where this process was late
                termination.leave()
        except (EOFError, OSError):
            orphaned_s = now_s
