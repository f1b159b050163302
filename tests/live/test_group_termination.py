"""SIGTERM to the whole process group: the station ends as if only its first process had got it; branch by branch."""

import contextlib
import multiprocessing as mp
import os
import signal
import threading
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from benchmarks.live_kill import Run, Units, wait_until
from groundstation.cli.stop_request import StopRequest
from groundstation.live.child_process import ChildProcess
from groundstation.live.head_device import DeviceError, HeadDevice
from groundstation.live.head_manager import HeadManager
from groundstation.live.head_process import _PipeSink, _serve
from groundstation.live.head_worker import HeadWorker
from groundstation.live.shutdown import Shutdown
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.simulation import device_simulator
from groundstation.simulation.device_simulator import DeviceSimulator, DeviceSimulatorConfig
from groundstation.simulation.standard_cases import standard_rig
from ptu_drivers import motion_guard
from ptu_drivers.deferred_termination import ENDING, GRACE_S, DeferredTermination
from ptu_drivers.emergency_halt import HaltLine
from ptu_drivers.motion_guard import MotionLeases
from tests.live.pipe_targets import defer_termination, leave_by_termination, note_blocked_signals
from tests.live.test_head_process_lost import operated, until
from tests.live.test_unreleased_heads import Process

TERMINATED = 128 + signal.SIGTERM
LONG_S = 60.0


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def handled() -> Iterator[None]:
    """SIGTERM's handler is as before afterwards."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


def signalled(clock: Clock) -> DeferredTermination:
    """Return the state after a SIGTERM that was deferred, and whose wait is over."""
    termination = DeferredTermination(clock)
    termination.install()
    with termination.deferred():
        os.kill(os.getpid(), signal.SIGTERM)
        assert not termination.is_due()
    clock.now_s += GRACE_S + 0.1
    return termination


# ------------------------------------------------------------------------------------ the whole station
@pytest.fixture
def station(tmp_path: Path) -> Iterator[tuple[Run, Units]]:
    """A whole station in operation, a process group, on units that a process of another group serves."""
    units = Units(tmp_path)
    run = Run(tmp_path, tmp_path / "run")
    try:
        assert wait_until(lambda: run.ready(0.0) < float("inf"), 240.0), run.reported()
        yield run, units
    finally:
        run.kill()
        units.stop()


def require_orderly_end(run: Run, units: Units, began_s: float) -> None:
    """Check that no process was lost, and that all heads stand."""
    code, reported = run.wait(began_s)[1], run.reported()
    assert not any(words in reported for words in ("SIGTERM", "may still turn", "Traceback")), reported
    # a busy machine may lose a process by itself
    assert code == (1 if "process" in reported else 0), reported
    # an acknowledged halt brakes for up to half a second
    time.sleep(0.5)
    now_s = time.monotonic()
    assert max(units.turned(now_s - 0.2, now_s).values()) == 0.0


def working(group: int) -> list[str]:
    """Return which of a group's two processes at the heads have not ended."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            name, rest = path.read_text(encoding="utf-8").partition("(")[2].rsplit(")", 1)
            state, _, its_group = rest.split()[:3]
            if int(its_group) == group and state != "Z" and name in ("ptus", "ptu-guard"):
                found.append(name)
    return found


def test_a_signal_to_the_group_ends_the_station_in_order(station: tuple[Run, Units]) -> None:
    """Expected: exit code 0 and no loss: both processes are there until the heads are parked and halted."""
    run, units = station
    assert sorted(working(run.process.pid)) == ["ptu-guard", "ptus"]
    began_s = time.monotonic()
    os.killpg(run.process.pid, signal.SIGTERM)
    require_orderly_end(run, units, began_s)


def test_a_second_signal_to_the_group_leaves_the_heads_halted(station: tuple[Run, Units]) -> None:
    """Expected: the first process is gone at once, without parking, and nothing of it is left once the heads stand."""
    run, units = station
    os.killpg(run.process.pid, signal.SIGTERM)
    # `StopRequest` takes it for the same request before
    time.sleep(1.1)
    os.killpg(run.process.pid, signal.SIGTERM)
    began_s = time.monotonic()
    run.wait(began_s)
    assert wait_until(lambda: max(units.stood(began_s, time.monotonic()).values()) < float("inf"), LONG_S)
    assert wait_until(lambda: not working(run.process.pid), LONG_S)
    time.sleep(0.5)
    now_s = time.monotonic()
    assert max(units.turned(now_s - 0.2, now_s).values()) == 0.0


# ------------------------------------------------------------------------------------ the two processes
def test_after_the_announcement_both_processes_ignore_it(tmp_path: Path) -> None:
    """Expected: well beyond the wait for the announcement the same processes work, and no loss is by the signal."""
    with operated("flir on a pty", tmp_path) as station:
        station.heads.announce_end()
        for pid in station.heads.pids.values():
            os.kill(pid, signal.SIGTERM)
        time.sleep(2.0 * GRACE_S)
        count = station.samples()
        assert until(lambda: station.samples() > count + 20)
    assert not any("SIGTERM" in loss for loss in station.heads.log.losses)


def test_a_guard_that_alone_is_signalled_ends(tmp_path: Path) -> None:
    """Expected: after the wait, as before; it is begun again, and the head turns."""
    with operated("flir on a pty", tmp_path) as station:
        os.kill(station.heads.pids["guard"], signal.SIGTERM)
        assert until(lambda: any("guard's process was ended by SIGTERM" in loss for loss in station.heads.log.losses))
        assert until(lambda: abs(station.speed(time.monotonic())) > 0.0)


@pytest.mark.usefixtures("handled")
def test_the_announcement_may_wait_in_the_pipe() -> None:
    """Expected: a process that was late for longer than the wait reads it before it judges; a stop is a stop."""
    here, there = mp.Pipe()
    here.send(ENDING)
    here.send("stop")
    assert not serve(there, signalled(Clock()))


@pytest.mark.usefixtures("handled")
def test_without_an_announcement_the_ptus_process_leaves() -> None:
    """Expected: with the code of SIGTERM; but in order, without it, where it is asked to stop, or is alone."""
    here, there = mp.Pipe()
    with pytest.raises(SystemExit) as left:
        serve(there, signalled(Clock()))
    assert left.value.code == TERMINATED
    here.send("stop")
    assert not serve(there, signalled(Clock()))
    here.close()
    assert not serve(there, signalled(Clock()))


def serve(pipe: Connection, termination: DeferredTermination) -> bool:
    return _serve(pipe, cast(dict[str, HeadWorker], {}), _PipeSink(pipe), MotionLeases(()), termination)


@pytest.mark.usefixtures("handled")
@pytest.mark.parametrize(("words", "halts"), [((), 0), (("halt",), 1), ((ENDING,), 0), ((ENDING, "halt"), 1)])
def test_an_announcement_is_no_request_to_halt(
    monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], halts: int
) -> None:
    """Expected: only "halt" halts; a guard that was signalled leaves where the announcement is missing."""
    requests: list[str] = []

    def halting(name: str, *_: object, **__: object) -> Any:
        return SimpleNamespace(request=lambda: requests.append(name), busy=False)

    monkeypatch.setattr(motion_guard, "HaltingThread", halting)
    here, there = mp.Pipe()
    for word in words:
        here.send(word)
    lines, leases = {"left": HaltLine(url="nowhere", protocol="flir")}, MotionLeases(("left",))
    termination = signalled(Clock())
    if ENDING in words:
        # it would otherwise go on without end
        threading.Timer(0.5, here.send, ("stop",)).start()
        motion_guard._guard(lines, leases, there, termination)
    else:
        with pytest.raises(SystemExit) as left:
            motion_guard._guard(lines, leases, there, termination)
        assert left.value.code == TERMINATED
    assert len(requests) == halts


@pytest.mark.usefixtures("handled")
def test_a_guard_without_a_parent_ends_when_all_is_halted() -> None:
    """Expected: not by the signal: the pipe's end and a signal to what is left come together."""
    here, there = mp.Pipe()
    here.close()
    motion_guard._guard({}, MotionLeases(()), there, signalled(Clock()))


# ------------------------------------------------------------------------------------ the state
@pytest.mark.usefixtures("handled")
def test_a_signal_is_due_after_the_wait_and_a_second_one_does_not_prolong_it() -> None:
    clock = Clock()
    termination = DeferredTermination(clock)
    termination.install()
    with termination.deferred():
        assert not termination.is_due()
        os.kill(os.getpid(), signal.SIGTERM)
        clock.now_s += GRACE_S - 0.1
        assert not termination.is_due()
        os.kill(os.getpid(), signal.SIGTERM)
        clock.now_s += 0.2
        assert termination.is_due()
        termination.note_parent_ends()
        assert not termination.is_due()
        os.kill(os.getpid(), signal.SIGTERM)
        clock.now_s += 100.0
        assert not termination.is_due()


@pytest.mark.usefixtures("handled")
def test_a_signal_that_is_not_deferred_ends_at_once() -> None:
    """Expected: while units are opened, and once the end was asked for."""
    termination = DeferredTermination()
    termination.install()
    with pytest.raises(SystemExit) as left:
        os.kill(os.getpid(), signal.SIGTERM)
    assert left.value.code == TERMINATED


def test_a_process_that_reads_its_modules_gets_the_signal_later() -> None:
    """Expected: it is handled as soon as the process is ready for it, and described as the signal."""
    opening = ChildProcess("opening", leave_by_termination)
    deferring = ChildProcess("deferring", defer_termination)
    for child in (opening, deferring):
        os.kill(child.pid, signal.SIGTERM)
    assert wait_until(lambda: not opening.is_alive(), LONG_S)
    assert opening.exit_description() == "was ended by SIGTERM"
    assert deferring.pipe.poll(LONG_S)
    assert deferring.is_alive()
    opening.kill()
    deferring.kill()


def test_a_process_is_terminated_while_it_opens_and_killed_while_it_defers() -> None:
    """Expected: neither hears the request; the first leaves in order, the second is killed within its time."""
    opening = ChildProcess("opening", leave_by_termination)
    deferring = ChildProcess("deferring", defer_termination)
    assert opening.pipe.poll(LONG_S)
    assert deferring.pipe.poll(LONG_S)
    assert opening.end("stop", 0.1, LONG_S)
    assert opening.exit_description() == "was ended by SIGTERM"
    assert not deferring.end("stop", 0.1, 0.1)
    assert deferring.exit_description() == "was ended by SIGKILL"


# ------------------------------------------------------------------------------------ the first process
def test_the_end_is_announced_when_the_shutdown_begins() -> None:
    """Expected: by whichever thread sees the request, and at once where it has begun; not once all has ended."""
    announced: list[str] = []
    wanted = threading.Event()
    shutdown, done = Shutdown(wanted.is_set), Shutdown(lambda: False)
    shutdown.on_begin(lambda: announced.append("first"))
    done.on_begin(lambda: announced.append("never"))
    done.done()
    assert not shutdown.requested()
    assert announced == []
    wanted.set()
    shutdown.watch()
    assert wait_until(lambda: announced == ["first"], LONG_S)
    shutdown.on_begin(lambda: announced.append("later"))
    assert wait_until(lambda: announced == ["first", "later"], LONG_S)
    shutdown.done()


def test_processes_that_begin_during_the_end_get_the_announcement_too() -> None:
    Process.made = {}
    heads = HeadManager({"left": HeadDevice(url="nowhere")}, 0.0, make=Process)  # type: ignore[arg-type]
    heads.announce_end()
    with heads:
        assert [p.sent for p in Process.made.values()] == [[ENDING], [ENDING]]
        heads.announce_end()
        assert [p.sent for p in Process.made.values()] == [[ENDING, ENDING]] * 2


@pytest.mark.parametrize(("stop", "expected"), [(True, KeyboardInterrupt), (False, DeviceError)])
def test_a_process_that_the_signal_ends_while_it_opens(stop: bool, expected: type[BaseException]) -> None:
    """Expected: the station was interrupted, and no device is blamed; without a request the process was lost."""

    class Ended(Process):
        def __init__(self, name: str, *given: Any) -> None:
            super().__init__(name, *given)
            if name == "ptus":
                while self.pipe.poll(0):
                    self.pipe.recv()
                self.other.close()

    Ended.made = {}
    heads = HeadManager({"left": HeadDevice(url="nowhere")}, 0.0, make=Ended)  # type: ignore[arg-type]
    heads.begin()
    with pytest.raises(expected):
        heads.opened(lambda: stop)


@pytest.mark.usefixtures("handled")
def test_two_signals_of_one_sender_are_one_request() -> None:
    """Expected: `timeout` sends two; a later one is a second request, which has the previous handler again."""
    clock, second = Clock(), list[int]()
    signal.signal(signal.SIGTERM, lambda number, _: second.append(number))
    with StopRequest(clock) as stop:
        os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGTERM)
        assert (stop(), second) == (True, [])
        clock.now_s += 1.5
        os.kill(os.getpid(), signal.SIGTERM)
        assert second == [signal.SIGTERM]


def test_the_simulated_range_never_gets_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Expected: SIGTERM is blocked there: heads are parked on its units, which end when they are asked to."""
    (tmp_path / "rig.toml").write_text(rig_to_toml(standard_rig(sigma_rad=1e-4)), encoding="utf-8")
    monkeypatch.setattr(device_simulator, "serve_devices", note_blocked_signals)
    config = DeviceSimulatorConfig(rig=tmp_path / "rig.toml", folder=tmp_path, flight=cast(Any, None))
    with DeviceSimulator(config):
        assert str(int(signal.SIGTERM)) in (tmp_path / "blocked").read_text(encoding="ascii").split()
