"""What is known of the heads in the pipeline's process, and what is reported of the processes that drive them."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from groundstation.live.input_queue import DeviceLogLine, InputQueue
from groundstation.pointing.head_limits import HeadLimits
from ptu_drivers.messages import UnitDescription
from ptu_drivers.motion_guard import GuardReport

# of the changes that are kept: some hours' worth, were one of the processes lost every minute
_SHOWN = 1000


@dataclass(slots=True)
class HeadState:
    """What is known of one head in the pipeline's process."""

    description: UnitDescription
    limits: HeadLimits
    state: str = ""
    failures: int = 0
    readings: int = 0
    newest_s: float = -math.inf
    delay_s: float = 0.0


class HeadLog:
    """States by station, and lines for the operator.

    Parameters
    ----------
    start_s : the session's time zero on ``clock``.
    """

    def __init__(self, start_s: float, clock: Callable[[], float]) -> None:
        self.states: dict[str, HeadState] = {}
        self.losses: list[str] = []
        """Each loss of a process in a line, and each head of which no halt is known."""
        self.changes = 0
        """Grows whenever a head's state changes in a way that the operator is to see at once."""
        self.shown: deque[tuple[float, str, str]] = deque(maxlen=_SHOWN)
        """The newest of these changes: when, on ``clock``, of which head, and its state in words."""
        self.input_queue: InputQueue | None = None
        self._start_s, self._clock = start_s, clock

    def note_opened(self, found: Mapping[str, tuple[UnitDescription, HeadLimits]], words: str) -> None:
        """Note what the heads were found to be; ``words`` are their state until they report one."""
        for name, (about, limits) in found.items():
            state = self.states.setdefault(name, HeadState(description=about, limits=limits))
            state.description, state.limits = about, limits
        if words:
            self.set_states(dict.fromkeys(found, words))

    def set_states(self, words: Mapping[str, str]) -> None:
        """Set heads' states, for the operator to see at once."""
        for name, state in words.items():
            if name in self.states:
                self.states[name].state = state
                self.shown.append((self._clock(), name, state))
        self.changes += 1

    def add_loss(self, text: str) -> None:
        """Keep a line of the losses."""
        self.losses.append(f"{self._clock() - self._start_s:.1f} s: {text}")

    def add(self, level: str, text: str) -> None:
        """Put a line into the log, if it has begun."""
        if self.input_queue is not None:
            self.input_queue.put(DeviceLogLine(t_s=self._clock() - self._start_s, level=level, text=text))

    def report_halts(self, names: Iterable[str], reports: Mapping[str, GuardReport], since_s: float) -> frozenset[str]:
        """Report what came of halting each head after the loss at ``since_s``; returns those not known to stand."""
        unknown = set()
        for name in names:
            report = reports.get(name)
            if report is not None and report.acknowledged:
                self.add(
                    "warning", f"{name}: halt acknowledged {report.ended_s - since_s:.2f} s after the loss was noticed"
                )
                self.set_states({name: "process lost, halted, restarting"})
            else:
                unknown.add(name)
                self.add("error", f"{name}: {not_halted(report)}")
                self.set_states({name: "process lost, may still turn, restarting"})
        return frozenset(unknown)

    def report_lease_expired(self, report: GuardReport) -> None:
        """Report what came of a halt that was due because nothing vouched for a head any more.

        No loss yet: on a busy machine the driver is only late, shares the line with the guard, and halts the head by
        itself once it comes round. If it does not, its process is lost; a lease that is left at the end is a loss, too.
        """
        if report.acknowledged:
            self.add("warning", f"{report.name}: its lease ran out; the motion guard halted it, which it acknowledged")
        else:
            self.add("error", f"{report.name}: its lease ran out; {not_halted(report)}")
            self.set_states({report.name: "lease ran out, may still turn"})

    def report_end(self, names: Iterable[str], reports: Mapping[str, GuardReport]) -> None:
        """Keep a line of each head that is not known to stand when everything ends."""
        for name in names:
            report = reports.get(name)
            if report is None or not report.acknowledged:
                self.add_loss(f"{name}: {not_halted(report)}")


def not_halted(report: GuardReport | None) -> str:
    """Return the message on a head that acknowledged no halt."""
    why = "the motion guard gave no answer" if report is None else report.why
    return f"no halt was acknowledged ({why}): the head may still turn"
