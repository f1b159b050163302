"""A head whose lease was not given back is not known to stand, however its process ended: stand-ins for processes."""

import math
import multiprocessing as mp
import time
from collections.abc import Callable
from typing import Any, ClassVar

import pytest

from groundstation.live.hang_detector import LONGEST_S, HangDetector, ProcessActivity
from groundstation.live.head_device import HeadDevice
from groundstation.live.head_manager import HeadManager
from groundstation.live.input_queue import DeviceLogLine, InputQueue
from groundstation.messages import PointingCommand, Purpose
from ptu_drivers.motion_guard import LEASE_S, GuardReport, MotionLeases

COMMAND = PointingCommand(
    t_s=0.0, station="left", pan_rad=0.0, tilt_rad=0.0, pan_rate_rad_s=0.1, tilt_rate_rad_s=0.0, purpose=Purpose.TRACK
)


class Process:
    """Replaces both processes: ends on request, and the guard's process acknowledges each request at once."""

    made: ClassVar[dict[str, "Process"]] = {}
    acknowledges = True
    gives_back = False
    clock: ClassVar[Callable[[], float]] = staticmethod(time.monotonic)

    def __init__(self, name: str, _target: object, *given: Any) -> None:
        self.name, self.given = name, given
        self.leases: MotionLeases = given[-1]
        self.pipe, self.other = mp.Pipe()
        self.sentinel = self.other.fileno()
        self.pid = 1
        self.sent: list[object] = []
        self.ended = False
        self.made[name] = self
        if name == "ptu-guard":
            self.leases.set_guard_heartbeat(self.clock() + 1e6)
        else:
            self.leases.set_driver_heartbeat(self.clock())
            for station in self.leases.names:
                self.leases.renew(station, self.clock() + 0.35)
            self.other.send({})

    def send(self, what: object) -> bool:
        self.sent.append(what)
        if self.name == "ptu-guard" and what == "halt":
            now_s = self.clock()
            for station in self.leases.names:
                self.other.send(
                    GuardReport(
                        name=station, acknowledged=self.acknowledges, began_s=now_s, ended_s=now_s, why="a dead line"
                    )
                )
        return True

    def is_alive(self) -> bool:
        return not self.ended

    def end(self, ask: object, _ask_s: float, _terminate_s: float) -> bool:
        self.sent.append(ask)
        self.ended = True
        if self.name == "ptus" and self.gives_back:
            for station in self.leases.names:
                self.leases.release(station)
        return True

    def kill(self, _grace_s: float = 0.0) -> None:
        self.ended = True

    def exit_description(self) -> str:
        return "ended with exit code 0"


def closed(kind: type[Process]) -> tuple[HeadManager, dict[str, Process]]:
    kind.made = {}
    heads = HeadManager({"left": HeadDevice(url="nowhere")}, 0.0, make=kind)  # type: ignore[arg-type]
    with heads:
        pass
    return heads, kind.made


def test_a_process_that_released_its_leases_needs_no_halt() -> None:
    class GivesBack(Process):
        gives_back = True

    heads, made = closed(GivesBack)
    assert heads.log.losses == []
    assert made["ptu-guard"].sent == ["stop"]


def test_a_process_that_ended_with_a_lease_in_force_has_its_head_halted_by_the_guard() -> None:
    """Expected: its driver got no acknowledgement; the guard gets the request, then ends; the loss is on record."""
    heads, made = closed(Process)
    assert made["ptu-guard"].sent == ["halt", "stop"]
    (loss,) = heads.log.losses
    assert "ended without an acknowledged halt of left" in loss


def test_a_head_that_does_not_reply_to_the_guard_may_still_turn() -> None:
    class Deaf(Process):
        acknowledges = False

    heads, _ = closed(Deaf)
    assert len(heads.log.losses) == 2
    assert "left: no halt was acknowledged (a dead line): the head may still turn" in heads.log.losses[1]


def test_a_process_that_is_lost_while_a_command_waits_to_be_sent_is_no_error() -> None:
    """Expected: the supervisor's thread takes the process away between the look at it and the sending."""
    heads = HeadManager({"left": HeadDevice(url="nowhere")}, 0.0, make=Process)  # type: ignore[arg-type]

    class Losing:
        """A lock in whose waiting time the process is lost."""

        def __enter__(self) -> None:
            heads._child = None

        def __exit__(self, *_: object) -> None:
            return None

    with heads:
        child = Process.made["ptus"]
        heads._sending = Losing()  # type: ignore[assignment]
        heads.send_command(COMMAND)
        assert heads._child is None
        assert child.sent == [COMMAND]


@pytest.mark.parametrize("acknowledges", [True, False])
def test_a_halt_by_the_guard_alone_is_reported(acknowledges: bool) -> None:
    """Expected: a lease ran out without a request: a line in the log, and no loss yet."""
    Process.made = {}
    heads = HeadManager({"left": HeadDevice(url="nowhere")}, 0.0, make=Process)  # type: ignore[arg-type]
    heads.log.input_queue = InputQueue()
    with heads:
        now_s = time.monotonic()
        Process.made["ptu-guard"].other.send(
            GuardReport(name="left", acknowledged=acknowledges, began_s=now_s, ended_s=now_s, why="a dead line")
        )
        heads.poll()
        lines = []
        while (item := heads.log.input_queue.get(0.0)) is not None:
            assert isinstance(item, DeviceLogLine)
            lines.append((item.level, item.text))
        ((level, text),) = lines
        assert level == ("warning" if acknowledges else "error")
        assert text.startswith("left: its lease ran out; ")
        assert ("may still turn" in text) is not acknowledges
        assert not heads.log.losses


def test_a_silent_process_that_has_something_to_do_is_given_a_second() -> None:
    """Expected: shown as silent when its leases end, killed no sooner than it may be back on a busy machine."""
    now = [100.0]

    class Simulated(Process):
        clock = staticmethod(lambda: now[0])

    Simulated.made = {}
    heads = HeadManager({"left": HeadDevice(url="nowhere")}, 0.0, clock=lambda: now[0], make=Simulated)  # type: ignore[arg-type]
    heads._hang_detector = HangDetector(lambda _: ProcessActivity(state="R", ticks=0))
    changes, killed_s = [], math.inf
    with heads:
        while math.isinf(killed_s) and now[0] < 105.0:
            before = heads.log.changes
            heads.poll()
            if heads.log.changes > before:
                changes.append(now[0] - 100.0)
            if Simulated.made["ptus"].ended:
                killed_s = now[0] - 100.0
            now[0] += 0.01
    assert changes[0] == pytest.approx(LEASE_S, abs=0.02)
    assert killed_s == pytest.approx(LONGEST_S, abs=0.02)
    assert "gave no sign for 1.0 s and was killed" in heads.log.losses[0]
