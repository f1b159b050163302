"""All PTUs in a process of their own: the time stamp of an angle is as good as the reader of the line is prompt.

In the pipeline's process a serial reply may lie for tens of milliseconds until the interpreter is free. Here nothing
else runs. Commands go in and readings come out through a pipe; if the pipeline's process ends, however it ends, the
pipe closes and every unit is halted. If this process ends, or hangs, the motion guard halts them: this
process renews its leases twenty times a second (`ptu_drivers.motion_guard`), and the guard sends a heartbeat too.
"""

import contextlib
import math
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection

from groundstation.errors import GroundstationError
from groundstation.live.head_device import HeadDevice, open_head
from groundstation.live.head_worker import HeadWorker, head_limits
from groundstation.live.input_queue import Item
from groundstation.messages import PointingCommand
from groundstation.thread_scheduling import short_gil_switch_interval
from ptu_drivers.deferred_termination import ENDING, DeferredTermination
from ptu_drivers.motion_guard import LEASE_S, MotionLeases

_HEALTH_EVERY_S = 0.25
_BEAT_S = 0.05
# halting and letting go of all units takes no longer; a process that leaves in order is given it
_LEAVE_S = 1.0
# a round of a head's thread is at the most a halt, which may take three exchanges, and a reading; beyond that, and so
# much for a busy machine, the driver hangs
_ROUND_EXCHANGES = 4
_HANGS_S = 1.0


@dataclass(frozen=True, slots=True)
class HeadReport:
    """Periodic status of one head, sent by its process."""

    station: str
    state: str
    failures: int
    delay_s: float


class _PipeSink:
    """The input queue in the pipeline's process, as seen from this one."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._lock = threading.Lock()

    def put(self, item: Item | HeadReport | str) -> None:
        """Send an item; a closed pipe is ignored here and detected by the main loop."""
        with self._lock, contextlib.suppress(OSError):
            self._pipe.send(item)


def serve_heads(heads: Mapping[str, HeadDevice], start_s: float, leases: MotionLeases, pipe: Connection) -> None:
    """Open the heads, report them, then read and move them until a stop is requested or the parent has ended.

    A ``MemoryError`` ends it as any other way out does: halted first. So does a head whose thread has ended or hangs,
    with exit code 1: the supervisor begins all of it again. A SIGTERM interrupts the opening and the end at once; in
    between it ends the process only where the parent is not ending as well (`DeferredTermination`).
    """
    lost = False
    # before a unit is opened, whose driver sets a handler where there is none
    termination = DeferredTermination()
    termination.install()
    with contextlib.ExitStack() as stack:
        try:
            units = {name: stack.enter_context(open_head(name, h, time.monotonic)) for name, h in heads.items()}
        except GroundstationError as fault:
            with contextlib.suppress(OSError):
                pipe.send(str(fault))
            return
        leases.set_driver_heartbeat(time.monotonic())
        try:
            pipe.send({name: (unit.describe(), head_limits(unit)) for name, unit in units.items()})
        except OSError:
            # the parent process has gone
            return
        pipe_sink = _PipeSink(pipe)
        workers = {
            name: HeadWorker(
                name, unit, pipe_sink, session_from_unit_s=-start_s, clock=time.monotonic, period_s=heads[name].poll_s
            )
            for name, unit in units.items()
        }
        for name, worker in workers.items():
            stack.callback(stop_and_release, name, worker, leases)
        # first of all: one that hangs is not to keep the others turning
        for worker in workers.values():
            stack.callback(worker.request_stop)
        stack.enter_context(short_gil_switch_interval())
        # the process sends no sign of life while it ends: announced ahead for so long
        stack.callback(lambda: leases.set_driver_heartbeat(time.monotonic() + _LEAVE_S))
        with contextlib.suppress(MemoryError), termination.deferred():
            lost = _serve(pipe, workers, pipe_sink, leases, termination)
    if lost:
        raise SystemExit(1)


def stop_and_release(name: str, worker: HeadWorker, leases: MotionLeases) -> None:
    """Stop a head, and give its lease back only where the unit has acknowledged the halt.

    Otherwise the lease runs out, and the motion guard halts the unit; so it is where a signal interrupts the stop.
    """
    if worker.stop():
        leases.release(name)


def _serve(
    pipe: Connection,
    workers: Mapping[str, HeadWorker],
    pipe_sink: _PipeSink,
    leases: MotionLeases,
    termination: DeferredTermination | None = None,
) -> bool:
    """Pass commands on until the other side stops or is gone; renew the leases, and report now and then.

    Returns whether it ended because a head's thread has ended or hangs; raises SystemExit for a SIGTERM that is due.
    """
    reported_s = -math.inf
    termination = termination or DeferredTermination()
    with contextlib.suppress(EOFError, OSError):
        while True:
            renew_leases(workers, leases, time.monotonic())
            if lost := unresponsive_heads(workers, time.monotonic()):
                for text in lost:
                    pipe_sink.put(text)
                return True
            if pipe.poll(_BEAT_S):
                what = pipe.recv()
                if what == "stop":
                    return False
                if what == "start":
                    for worker in workers.values():
                        worker.start()
                elif what == ENDING:
                    termination.note_parent_ends()
                elif isinstance(what, PointingCommand) and what.station in workers:
                    workers[what.station].set_command(what)
            # the announcement may wait in the pipe where this process was late
            if termination.is_due() and not pipe.poll(0):
                termination.leave()
            now_s = time.monotonic()
            if now_s - reported_s >= _HEALTH_EVERY_S:
                reported_s = now_s
                for name, worker in workers.items():
                    failures = sum(worker.health.failures.values())
                    pipe_sink.put(HeadReport(name, state_text(worker, now_s), failures, worker.delay_s))
    return False


def unresponsive_heads(workers: Mapping[str, HeadWorker], now_s: float) -> list[str]:
    """Return a line for each head whose thread has ended, or has not come round for longer than its driver may take."""
    lost = []
    for name, worker in workers.items():
        late_s = now_s - worker.last_cycle_s
        if worker.ended:
            lost.append(f"{name}: PTU: its thread has ended")
        elif late_s > _ROUND_EXCHANGES * worker.unit.describe().reply_timeout_s + _HANGS_S:
            lost.append(f"{name}: PTU: its driver has not returned for {late_s:.1f} s")
    return lost


def state_text(worker: HeadWorker, now_s: float) -> str:
    """Return the unit's state as text; a fixed text for a thread that has ended or is late."""
    if worker.ended:
        return "thread ended"
    return worker.health.state.value if _is_responsive(worker, now_s) else "driver does not return"


def renew_leases(workers: Mapping[str, HeadWorker], leases: MotionLeases, now_s: float) -> None:
    """Renew the leases of units whose threads respond; hold all units still while the guard has no heartbeat.

    A thread may wait as long as its unit may take to answer, and a lease's length on top.
    """
    leases.set_driver_heartbeat(now_s)
    unguarded = now_s - leases.guard_heartbeat_s > LEASE_S
    for name, worker in workers.items():
        worker.set_hold(unguarded)
        if not worker.ended and _is_responsive(worker, now_s):
            leases.renew(name, now_s + LEASE_S)


def _is_responsive(worker: HeadWorker, now_s: float) -> bool:
    return now_s - worker.last_cycle_s < worker.unit.describe().reply_timeout_s + LEASE_S
