"""Distinguish a process that hangs from one that waits for processor time on a busy machine.

Heads are halted when a lease has run out, whatever the reason. Only a process that does not recover by itself is
killed. The system's process state distinguishes the cases: a stopped process never recovers, a process that keeps on
sleeping is unlikely to, and one that is ready to run, or has running threads, may only lack processor time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ptu_drivers.motion_guard import LEASE_S

# ten beats missed by a process that sleeps; twenty by one that has something to do
ASLEEP_S = 0.5
LONGEST_S = 1.0
# of proc_pid_stat(5): stopped, by a debugger too, and dead
_STOPPED = frozenset("TtZXx")
_ASLEEP = frozenset("SD")


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessActivity:
    """A process as the system sees it: the letter of its main thread's state, and the processor time of all, ticks."""

    state: str
    ticks: int


def activity(pid: int) -> ProcessActivity:
    """Return what a process does; without a letter where the system does not tell."""
    try:
        # the name in brackets may contain anything
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        return ProcessActivity(state=fields[0], ticks=int(fields[11]) + int(fields[12]))
    except (OSError, ValueError, IndexError):
        return ProcessActivity(state="", ticks=0)


class HangDetector:
    """Judges one process; `hangs` is to be called over and over.

    Parameters
    ----------
    look : what a process does, by its number.
    """

    def __init__(self, look: Callable[[int], ProcessActivity] = activity) -> None:
        self._look = look
        self._pid = 0
        self._ticks: int | None = None

    def hangs(self, pid: int, silent_s: float) -> bool:
        """Return whether a process that has given no sign for ``silent_s`` is to be killed."""
        if silent_s <= LEASE_S or pid != self._pid:
            self._pid, self._ticks = pid, None
        if silent_s <= LEASE_S:
            return False
        now = self._look(pid)
        if self._ticks is None:
            self._ticks = now.ticks
        if now.state in _STOPPED:
            return True
        asleep = now.state in _ASLEEP and now.ticks == self._ticks
        return silent_s > (ASLEEP_S if asleep else LONGEST_S)
