"""All PTUs in a process of their own: an angle's instant is only as good as the promptness of whoever reads the line.

In the pipeline's process a serial reply may lie for tens of milliseconds until the interpreter is free. Here nothing
else runs. Commands go in and readings come out through a pipe; if the pipeline's process ends, however it ends, the
pipe closes and every unit is halted.
"""

import contextlib
import math
import multiprocessing as mp
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import TracebackType

from groundstation.errors import GroundstationError
from groundstation.hand_over import quick_hand_over
from groundstation.live.child import deaf_to_the_terminal
from groundstation.live.head_device import DeviceError, HeadDevice, open_head
from groundstation.live.head_worker import HeadWorker, head_limits
from groundstation.live.inbox import Inbox, Item, Said
from groundstation.messages import PointingCommand, PtuSample
from groundstation.pointing import HeadLimits
from ptu_drivers.messages import UnitDescription

# opening raises bauds and may wait for a unit that homes
_OPEN_S = 90.0
_STOP_S = 10.0
_HEALTH_EVERY_S = 0.25
# the pipe holds the commands of some seconds
_DEAF_AFTER_S = 2.0


@dataclass(slots=True)
class HeadState:
    """What is known of one head in the pipeline's process."""

    description: UnitDescription
    limits: HeadLimits
    state: str = ""
    doubts: int = 0
    readings: int = 0
    newest_s: float = -math.inf
    delay_s: float = 0.0


@dataclass(frozen=True, slots=True)
class _Told:
    """How a head does, from its process now and then."""

    station: str
    state: str
    doubts: int
    delay_s: float


class _Outbox:
    """The inbox in the pipeline's process, as seen from this one."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._lock = threading.Lock()

    def put(self, item: Item | _Told) -> None:
        """Send it; that nobody is there any more is no error here, the main loop notices."""
        with self._lock, contextlib.suppress(OSError):
            self._pipe.send(item)


class Heads:
    """The PTUs as the pipeline's process meets them; a context manager that halts them on the way out.

    Parameters
    ----------
    heads : by station.
    start_s : the session's time zero on the host's monotonic clock.

    Raises `DeviceError` on ``with`` where one cannot be opened.
    """

    def __init__(self, heads: Mapping[str, HeadDevice], start_s: float) -> None:
        self.states: dict[str, HeadState] = {}
        self.ended = False
        self._heads, self._start_s = dict(heads), start_s
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None
        self._thread: threading.Thread | None = None
        self._inbox: Inbox | None = None
        self._stopping = False
        self._heard_s = -math.inf

    def __enter__(self) -> "Heads":
        self.begin()
        return self.opened()

    def begin(self) -> None:
        """Start the process, which opens the heads while its parent does something else; `close` is due from then."""
        if not self._heads:
            return
        context = mp.get_context("spawn")
        self._pipe, other = context.Pipe()
        process = context.Process(
            target=serve_heads, args=(self._heads, self._start_s, other), name="ptus", daemon=True
        )
        with deaf_to_the_terminal():
            process.start()
        self._process = process
        other.close()

    def opened(self) -> "Heads":
        """Wait until the heads are opened; raises `DeviceError` where one cannot be."""
        process = self._process
        if process is None or self._pipe is None:
            return self
        try:
            if not self._pipe.poll(_OPEN_S):
                raise DeviceError(f"PTUs: got no answer within {_OPEN_S:.0f} s; wanted them opened")
            answer = self._pipe.recv()
        except EOFError as fault:
            raise DeviceError("PTUs: their process ended while opening them") from fault
        finally:
            if not self._pipe.poll(0) and not process.is_alive():
                self.close()
        if isinstance(answer, str):
            self.close()
            raise DeviceError(answer)
        self.states = {name: HeadState(description=about, limits=limits) for name, (about, limits) in answer.items()}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def start(self, inbox: Inbox) -> None:
        """Let readings come into an inbox from now on."""
        self._inbox = inbox
        self._heard_s = time.monotonic()
        if self._pipe is None:
            return
        self._send("start")
        self._thread = threading.Thread(target=self._receive, name="ptus", daemon=True)
        self._thread.start()

    def tell(self, command: PointingCommand) -> None:
        """Hand a command on; never waits: to a process that has not been heard of, nothing is sent."""
        if time.monotonic() - self._heard_s < _DEAF_AFTER_S:
            self._send(command)

    def _send(self, what: object) -> None:
        if self._pipe is not None and not self.ended:
            try:
                self._pipe.send(what)
            except OSError:
                self.ended = True

    def _receive(self) -> None:
        inbox, pipe = self._inbox, self._pipe
        if inbox is None or pipe is None:
            return
        with contextlib.suppress(EOFError, OSError):
            while True:
                item = pipe.recv()
                self._heard_s = time.monotonic()
                if isinstance(item, _Told):
                    state = self.states[item.station]
                    state.state, state.doubts, state.delay_s = item.state, item.doubts, item.delay_s
                    continue
                if isinstance(item, PtuSample):
                    state = self.states[item.station]
                    state.readings += 1
                    state.newest_s = item.t_s
                inbox.put(item)
        self.ended = True
        if not self._stopping:
            now_s = time.monotonic() - self._start_s
            inbox.put(Said(t_s=now_s, level="error", text="the PTUs' process has ended: no angles, and nothing turns"))

    def close(self) -> None:
        """Halt the heads and end their process."""
        self._stopping = True
        if self._pipe is not None:
            with contextlib.suppress(OSError):
                self._pipe.send("stop")
        if self._process is not None:
            self._process.join(_STOP_S)
            if self._process.is_alive():
                self._process.terminate()
                self._process.join(2.0)
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None


def serve_heads(heads: Mapping[str, HeadDevice], start_s: float, pipe: Connection) -> None:
    """Open the heads, tell what they are, then read and move them until told to stop, or nobody is there any more."""
    with contextlib.ExitStack() as stack:
        try:
            units = {name: stack.enter_context(open_head(name, h, time.monotonic)) for name, h in heads.items()}
        except GroundstationError as fault:
            with contextlib.suppress(OSError):
                pipe.send(str(fault))
            return
        try:
            pipe.send({name: (unit.describe(), head_limits(unit)) for name, unit in units.items()})
        except OSError:
            # nobody waits for it any more
            return
        outbox = _Outbox(pipe)
        workers = {
            name: HeadWorker(
                name, unit, outbox, session_from_unit_s=-start_s, clock=time.monotonic, period_s=heads[name].poll_s
            )
            for name, unit in units.items()
        }
        for worker in workers.values():
            stack.callback(worker.stop)
        stack.enter_context(quick_hand_over())
        _obey(pipe, workers, outbox)


def _obey(pipe: Connection, workers: Mapping[str, HeadWorker], outbox: _Outbox) -> None:
    """Pass commands on until the other side stops or is gone; say now and then how the heads do."""
    told_s = -math.inf
    with contextlib.suppress(EOFError, OSError):
        while True:
            if pipe.poll(_HEALTH_EVERY_S):
                what = pipe.recv()
                if what == "stop":
                    return
                if what == "start":
                    for worker in workers.values():
                        worker.start()
                elif isinstance(what, PointingCommand) and what.station in workers:
                    workers[what.station].tell(what)
            now_s = time.monotonic()
            if now_s - told_s >= _HEALTH_EVERY_S:
                told_s = now_s
                for name, worker in workers.items():
                    health = worker.unit.health()
                    told = _Told(name, health.state.value, sum(health.doubts.values()), worker.delay_s)
                    outbox.put(told)
