"""Manager of the PTU process: passes readings and commands, supervises the process and restarts it.

It is lost when it ends, or hangs (`HangDetector`): then it is killed, the motion guard halts every head over lines
of its own, and it is begun again (`RestartDelay`). The guard's process is supervised in the same way; without it the
PTUs' process holds all heads still by itself. Each head's state is reported, including when it is unknown.
"""

import math
import threading
import time
from collections.abc import Callable, Mapping
from enum import StrEnum
from multiprocessing.connection import wait
from types import TracebackType

from groundstation.live.child_process import ChildProcess
from groundstation.live.hang_detector import HangDetector
from groundstation.live.head_device import DeviceError, HeadDevice
from groundstation.live.head_log import HeadLog, HeadState
from groundstation.live.head_process import HeadReport, serve_heads
from groundstation.live.input_queue import InputQueue, Item
from groundstation.live.motion_guard_process import GuardProcess
from groundstation.live.restart_delay import RestartDelay
from groundstation.messages import PointingCommand, PtuSample
from groundstation.pointing.head_limits import HeadLimits
from ptu_drivers.deferred_termination import ENDING
from ptu_drivers.messages import UnitDescription
from ptu_drivers.motion_guard import HALTING_S, LEASE_S, GuardReport, MotionLeases

# opening raises bauds and may wait for a unit that homes
_OPEN_S = 90.0
_LOOK_S = 0.05
# after a pause of the supervisor this long, all timeouts restart
_ABSENT_S = 0.2
# a guard's report may come so much later than its last try begins: one that connects hangs for seconds
_REPORT_S = 1.0
# of the time for closing: until it is terminated, until it is killed, and for the guard to halt what was killed
CLOSE_S = 1.5
_ASK_SHARE, _TERMINATE_SHARE, _HALT_SHARE = 0.5, 0.15, 0.35
# a process whose pipe has closed is gone soon
_GRACE_S = 0.5


class ProcessPhase(StrEnum):
    """Life-cycle phase of the PTU process."""

    OPENING = "opening"
    RUNNING = "running"
    HALTING = "halting"
    WAITING = "waiting"
    CLOSED = "closed"


class HeadManager:
    """Interface to the PTUs in the pipeline's process; a context manager that halts them on exit.

    Parameters
    ----------
    heads : by station.
    start_s : the session's time zero on the host's monotonic clock.
    clock : that clock. make : begins a process; a stand-in for tests.

    Raises `DeviceError` on ``with`` where one cannot be opened.
    """

    def __init__(
        self,
        heads: Mapping[str, HeadDevice],
        start_s: float,
        *,
        clock: Callable[[], float] = time.monotonic,
        make: Callable[..., ChildProcess] = ChildProcess,
    ) -> None:
        self.log = HeadLog(start_s, clock)
        self._heads, self._start_s, self._clock, self._make = dict(heads), start_s, clock, make
        self._leases = MotionLeases(tuple(self._heads))
        self._guard = GuardProcess(self._heads, self._leases, clock, self._on_guard_lost, self._on_guard_halt, make)
        self._child: ChildProcess | None = None
        self._phase = ProcessPhase.CLOSED
        self._delay = RestartDelay()
        self._unknown: frozenset[str] = frozenset()
        self._leaving = self._silent = self._ending = False
        self._hang_detector = HangDetector()
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        self._sending = threading.Lock()
        self._polled_s = self._since_s = -math.inf
        self._lost_s = self._due_s = self._begun_s = 0.0

    def __enter__(self) -> "HeadManager":
        self.begin()
        return self.opened()

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def states(self) -> dict[str, HeadState]:
        """What is known of each head, by station."""
        return self.log.states

    @property
    def running(self) -> bool:
        """Whether the heads can be turned: both processes are there and do their work, as far as is known."""
        return self._phase is ProcessPhase.RUNNING and self._guard.ready()

    @property
    def pids(self) -> dict[str, int]:
        """The numbers of the processes: ``ptus`` and ``guard``; 0 where there is none at the moment."""
        return {"ptus": 0 if self._child is None else self._child.pid, "guard": self._guard.pid}

    def begin(self) -> None:
        """Start the processes, which open the heads while this one does something else; `close` is due from then."""
        if self._heads:
            self._guard.begin()
            self._begin_process()

    def opened(self, stop: Callable[[], bool] = lambda: False) -> "HeadManager":
        """Wait until the heads are opened.

        Raises `DeviceError` where one cannot be, KeyboardInterrupt where ``stop`` is set meanwhile.
        """
        child = self._child
        if child is None:
            return self
        try:
            end_s = self._clock() + _OPEN_S
            while not child.pipe.poll(_LOOK_S):
                if stop():
                    raise KeyboardInterrupt
                if self._clock() > end_s:
                    raise DeviceError(f"PTUs: got no answer within {_OPEN_S:.0f} s; wanted them opened")
            answer = child.pipe.recv()
            if isinstance(answer, str):
                raise DeviceError(answer)
        except EOFError as fault:
            self.close()
            # a signal to the group ends a process that opens
            if stop():
                raise KeyboardInterrupt from fault
            raise DeviceError("PTUs: their process ended while opening them") from fault
        except (DeviceError, KeyboardInterrupt):
            self.close()
            raise
        self._on_opened(answer)
        return self

    def start(self, input_queue: InputQueue) -> None:
        """Put readings into an input queue from now on."""
        self.log.input_queue = input_queue
        if self._child is None:
            return
        self._send("start")
        self._thread = threading.Thread(target=self._supervise, name="ptus", daemon=True)
        self._thread.start()

    def send_command(self, command: PointingCommand) -> None:
        """Send a command; does not block. Commands are dropped while the process has no current heartbeat."""
        if self._phase is ProcessPhase.RUNNING and self._clock() - self._leases.driver_heartbeat_s < LEASE_S:
            self._send(command)

    def announce_end(self) -> None:
        """Announce to both processes that this one is ending: a SIGTERM to the group is not for them; from any thread.

        They continue until they are asked to end, or this process is gone. Once is enough, more often does no harm.
        """
        # before the child is looked at: one that is begun meanwhile gets it from `_begin_process`
        self._ending = True
        self._guard.announce_end()
        self._send(ENDING)

    def close(self, within_s: float = CLOSE_S) -> None:
        """Halt the heads and end both processes, by force where they do not end, within about ``within_s``."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join(_ASK_SHARE * within_s)
        if self._phase is ProcessPhase.CLOSED:
            return
        end_s = self._clock() + within_s
        phase, self._phase = self._phase, ProcessPhase.CLOSED
        halting = phase is ProcessPhase.HALTING
        if self._child is not None:
            killed = self._end_process(self._child, within_s)
            # what it has given back has acknowledged its halt; of all else nothing is known, however it ended
            kept = [name for name in self._heads if self._leases.until_s(name)]
            self._unknown |= set(kept)
            if killed and self._unknown:
                self.log.add_loss("the PTUs' process did not end and was killed")
            elif kept:
                self.log.add_loss(f"the PTUs' process ended without an acknowledged halt of {', '.join(kept)}")
        if self._unknown:
            self._guard.request_halt()
            halting = True
        if halting:
            self._await_halts(max(end_s, self._clock() + _HALT_SHARE * within_s))
        self._guard.end()

    def _end_process(self, child: ChildProcess, within_s: float) -> bool:
        """End the process; returns whether it had to be killed."""
        beat_s = self._leases.driver_heartbeat_s
        if beat_s and self._hang_detector.hangs(child.pid, self._clock() - beat_s):
            # a process that hangs handles no request
            child.kill()
            return True
        return not child.end("stop", _ASK_SHARE * within_s, _TERMINATE_SHARE * within_s)

    # --------------------------------------------------------------------------------- the supervisor
    def _supervise(self) -> None:
        while not self._stopping.is_set():
            handles = self._guard.handles
            if self._child is not None:
                handles = [*handles, self._child.pipe, self._child.sentinel]
            try:
                wait(handles, _LOOK_S)
                self.poll()
            except Exception as fault:  # noqa: BLE001 - no memory, no process to be had: it goes on and tries again
                self.log.add_loss(f"supervising the PTUs: {type(fault).__name__}: {fault}")
                self.log.add("error", f"supervising the PTUs: {type(fault).__name__}: {fault}")
                self._stopping.wait(_ABSENT_S)

    def poll(self) -> None:
        """Receive pending messages and advance the phases; called periodically by the supervisor thread."""
        now_s = self._clock()
        if now_s - self._polled_s > _ABSENT_S:
            self._since_s = now_s
        self._polled_s = now_s
        ended = self._child is not None and not self._receive_all(self._child)
        self._guard.poll(self._since_s)
        if self._phase in (ProcessPhase.RUNNING, ProcessPhase.OPENING) and self._child is not None:
            self._check_process(self._child, now_s, ended)
        elif self._phase is ProcessPhase.HALTING:
            self._check_halts(now_s)
        elif self._phase is ProcessPhase.WAITING and now_s >= self._due_s:
            self._begin_process()

    def _receive_all(self, child: ChildProcess) -> bool:
        """Take what has come from the process; returns False once it is gone."""
        try:
            while child.pipe.poll(0):
                self._receive(child.pipe.recv())
        except (EOFError, OSError):
            return False
        return True

    def _receive(self, item: Item | HeadReport | str | dict[str, tuple[UnitDescription, HeadLimits]]) -> None:
        if isinstance(item, dict):
            self._on_opened(item)
            self._send("start")
            self.log.add("info", f"the PTUs' process runs again, restart {self._delay.restarts}")
        elif isinstance(item, str):
            self.log.add("error", f"{item}; tried again")
        elif isinstance(item, HeadReport):
            state = self.states[item.station]
            held = "" if self._guard.ready() else "held still: no motion guard, unit "
            state.state, state.failures, state.delay_s = held + item.state, item.failures, item.delay_s
        else:
            if isinstance(item, PtuSample):
                self.states[item.station].readings += 1
                self.states[item.station].newest_s = item.t_s
            if self.log.input_queue is not None:
                self.log.input_queue.put(item)

    def _check_process(self, child: ChildProcess, now_s: float, ended: bool) -> None:
        """Detect that the process has ended, hangs, or cannot open its heads."""
        beat_s = self._leases.driver_heartbeat_s
        silent_s = now_s - max(beat_s, self._since_s, self._begun_s)
        if beat_s > now_s + _LOOK_S and not self._leaving:
            # so far ahead it vouches only once it leaves
            self._leaving = True
            self.log.set_states(dict.fromkeys(self._heads, "process ends, halting"))
        if ended or not child.is_alive():
            child.kill(_GRACE_S)
            self._on_process_lost(child.exit_description(), now_s)
            return
        if self._phase is ProcessPhase.RUNNING and (silent_s > LEASE_S) is not self._silent:
            # no lease is renewed meanwhile: the guard halts the heads by itself
            self._silent = silent_s > LEASE_S
            self.log.set_states(
                dict.fromkeys(self._heads, "process silent, being halted" if self._silent else "process back")
            )
        hangs = self._hang_detector.hangs(child.pid, silent_s)
        if hangs if self._phase is ProcessPhase.RUNNING else silent_s > _OPEN_S:
            # SIGTERM would wait for the thread that hangs
            child.kill()
            self._on_process_lost(f"gave no sign for {silent_s:.1f} s and was killed", now_s)

    def _on_process_lost(self, why: str, now_s: float) -> None:
        """Request a halt of every head after the process is lost."""
        self._child = None
        self._phase, self._lost_s = ProcessPhase.HALTING, now_s
        for name in self._heads:
            self._leases.release(name)
        self._guard.request_halt()
        self.log.add_loss(f"the PTUs' process {why}")
        self.log.add("error", f"the PTUs' process {why}: no angles; the motion guard halts the heads")
        self.log.set_states(dict.fromkeys(self._heads, "process lost, being halted"))

    def _check_halts(self, now_s: float) -> None:
        """Report the guard's halts and schedule the restart."""
        results = self._guard.results()
        if len(results) < len(self._heads) and now_s < self._lost_s + HALTING_S + _REPORT_S:
            return
        self._unknown = self.log.report_halts(self._heads, results, self._lost_s)
        self._guard.settled()
        self._phase, self._due_s = ProcessPhase.WAITING, self._delay.lost(now_s)

    def _on_guard_lost(self, why: str) -> None:
        self.log.add_loss(f"the motion guard's process {why}")
        self.log.add("error", f"the motion guard's process {why}: heads are held still until it runs again")
        if self._phase is ProcessPhase.RUNNING:
            self.log.set_states(dict.fromkeys(self._heads, "held still: no motion guard"))

    def _on_guard_halt(self, report: GuardReport) -> None:
        """A lease expired: the head's thread, or its whole process, did not renew it."""
        if self._phase is not ProcessPhase.CLOSED:
            self.log.report_lease_expired(report)

    def _begin_process(self) -> None:
        self._leases.set_driver_heartbeat(0.0)
        self._leaving = self._silent = False
        self._begun_s = self._clock()
        self._child = self._make("ptus", serve_heads, self._heads, self._start_s, self._leases)
        if self._ending:
            self._send(ENDING)
        self._phase = ProcessPhase.OPENING

    def _on_opened(self, found: dict[str, tuple[UnitDescription, HeadLimits]]) -> None:
        """Record the opened heads and enter the running phase."""
        self.log.note_opened(found, "" if self.log.input_queue is None else "process restarted")
        self._unknown = frozenset()
        self._begun_s = self._clock()
        self._delay.began(self._begun_s)
        self._phase = ProcessPhase.RUNNING

    def _await_halts(self, until_s: float) -> None:
        """Wait for the guard's final reports; record each head without an acknowledged halt."""
        while len(self._guard.results()) < len(self._heads) and self._clock() < until_s:
            wait(self._guard.handles, _LOOK_S)
            self._guard.poll(self._since_s)
        self.log.report_end(self._heads, self._guard.results())

    def _send(self, what: object) -> None:
        # the supervisor's thread may lose the process meanwhile; sending to one that is gone does nothing
        child = self._child
        with self._sending:
            if child is not None:
                child.send(what)
