"""Handle of the motion guard's process: start, halt requests, supervision, restart."""

from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection

from groundstation.live.child_process import ChildProcess
from groundstation.live.hang_detector import HangDetector
from groundstation.live.head_device import HeadDevice
from groundstation.live.restart_delay import RestartDelay
from ptu_drivers.deferred_termination import ENDING
from ptu_drivers.emergency_halt import HaltLine
from ptu_drivers.motion_guard import LEASE_S, GuardReport, MotionLeases, serve_guard

# it only imports the drivers; a busy machine may take long for that
_START_S = 30.0
_ASK_S, _TERMINATE_S = 0.15, 0.1
# a process whose pipe has closed is gone a moment later
_GRACE_S = 0.2


def halt_lines(heads: Mapping[str, HeadDevice]) -> dict[str, HaltLine]:
    """Return how each head is reached to be halted only."""
    return {
        name: HaltLine(url=h.url, protocol=h.protocol, options=dict(h.options), baud=h.baud)
        for name, h in heads.items()
    }


class GuardProcess:
    """Supervised process that halts heads whose own process is lost.

    Parameters
    ----------
    lose : called with the reason whenever this process is lost.
    report : gets what came of a halt that was not requested, but due because a lease ran out.
    make : begins a process; a stand-in for tests.
    """

    def __init__(
        self,
        heads: Mapping[str, HeadDevice],
        leases: MotionLeases,
        clock: Callable[[], float],
        lose: Callable[[str], None],
        report: Callable[[GuardReport], None],
        make: Callable[..., ChildProcess] = ChildProcess,
    ) -> None:
        self._lines, self._leases, self._clock, self._lose, self._make = halt_lines(heads), leases, clock, lose, make
        self._report = report
        self._child: ChildProcess | None = None
        self._hang_detector = HangDetector()
        self._delay = RestartDelay()
        self._due_s = self._begun_s = 0.0
        self._requested_s: float | None = None
        self._reports: dict[str, GuardReport] = {}
        self._ending = False

    def begin(self) -> None:
        """Start the process."""
        # discard the previous process's heartbeat
        self._leases.set_guard_heartbeat(0.0)
        self._begun_s = self._clock()
        self._child = self._make("ptu-guard", serve_guard, self._lines, self._leases)
        self._delay.began(self._begun_s)
        if self._ending:
            self._child.send(ENDING)
        if self._requested_s is not None:
            self._child.send("halt")

    @property
    def handles(self) -> list[Connection | int]:
        """What `multiprocessing.connection.wait` takes."""
        return [] if self._child is None else [self._child.pipe, self._child.sentinel]

    @property
    def pid(self) -> int:
        """The process's number; 0 while there is none."""
        return 0 if self._child is None else self._child.pid

    def ready(self) -> bool:
        """Return whether the guard's heartbeat is current."""
        return self._child is not None and self._clock() - self._leases.guard_heartbeat_s <= LEASE_S

    def poll(self, since_s: float) -> None:
        """Take its reports; begin it again if it has ended, or hangs (silence before ``since_s`` does not count)."""
        now_s = self._clock()
        if self._child is None:
            if now_s >= self._due_s:
                self.begin()
            return
        why = ""
        try:
            while self._child.pipe.poll(0):
                report = self._child.pipe.recv()
                self._reports[report.name] = report
                if self._requested_s is None or report.began_s < self._requested_s:
                    self._report(report)
        except (EOFError, OSError):
            self._child.kill(_GRACE_S)
            why = self._child.exit_description()
        beat_s = self._leases.guard_heartbeat_s
        silent_s = now_s - max(beat_s, since_s)
        if not why and (
            self._hang_detector.hangs(self._child.pid, silent_s) if beat_s else now_s - self._begun_s > _START_S
        ):
            self._child.kill()
            why = f"gave no sign for {silent_s:.1f} s and was killed"
        if why:
            self._child = None
            self._due_s = self._delay.lost(now_s)
            self._lose(why)

    def announce_end(self) -> None:
        """Announce that this process is ending: a SIGTERM to the group is not for the guard; from any thread."""
        # before the child is looked at: one that is begun meanwhile gets it from `begin`
        self._ending = True
        child = self._child
        if child is not None:
            child.send(ENDING)

    def request_halt(self) -> None:
        """Request a halt of all heads; see `results` for the outcome."""
        self._requested_s = self._clock()
        if self._child is not None:
            self._child.send("halt")

    def results(self) -> dict[str, GuardReport]:
        """Return what came of the last request, by station, as far as it is known."""
        since_s = self._clock() if self._requested_s is None else self._requested_s
        return {name: r for name, r in self._reports.items() if r.began_s >= since_s}

    def settled(self) -> None:
        """The last request is over, whatever came of it; a guard that is begun again need not halt for it."""
        self._requested_s = None

    def end(self) -> None:
        """End the process."""
        if self._child is not None:
            self._child.end("stop", _ASK_S, _TERMINATE_S)
            self._child = None
