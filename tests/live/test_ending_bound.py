"""The end comes within its time, whatever hangs: on a simulated clock, and with the PTUs' process truly stopped."""

import multiprocessing as mp
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchmarks.live_kill import Run, Units, recorded_until, wait_until
from groundstation.live.child_process import ChildProcess
from groundstation.live.restart_delay import RestartDelay
from groundstation.live.shutdown import END_S, PARK_S, Shutdown
from tests.live.pipe_targets import ignore_everything, wait_for_word


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def ending(clock: Clock, stop: Callable[[], bool] = lambda: True, park_s: float | None = None) -> Shutdown:
    return Shutdown(stop, park_s, clock=clock)


def test_parking_is_part_of_the_whole() -> None:
    clock = Clock()
    end = ending(clock)
    assert (end.bound_s, end.parking_s) == (END_S, PARK_S) == (3.0, 1.5)
    assert not end.may_park()
    assert end.requested()
    assert end.may_park()
    clock.now_s += 1.49
    assert end.may_park()
    clock.now_s += 0.02
    assert not end.may_park()


def test_a_station_that_parks_for_longer_has_its_time_on_top() -> None:
    clock = Clock()
    end = ending(clock, park_s=8.0)
    assert end.bound_s == 11.0
    end.begin()
    clock.now_s += 7.9
    assert end.may_park()


def test_the_time_runs_from_the_first_wish_on() -> None:
    clock, wanted = Clock(), [False]
    end = ending(clock, lambda: wanted[0])
    assert not end.requested()
    clock.now_s += 50.0
    assert not end.overdue()
    wanted[0] = True
    assert end.requested()
    clock.now_s += 2.9
    assert end.requested()
    assert not end.overdue()
    clock.now_s += 0.11
    assert end.overdue()


def test_the_steps_of_the_end_share_the_remaining_time() -> None:
    clock = Clock()
    end = ending(clock)
    assert end.left_s(1.5) == 1.5
    end.begin()
    assert end.left_s(1.5) == 1.5
    clock.now_s += 1.5
    # what the files need is kept
    assert end.left_s(1.5) == pytest.approx(0.9)
    clock.now_s += 10.0
    assert end.left_s(1.5) == pytest.approx(0.1)


def test_a_recorder_that_writes_is_waited_for_and_one_that_does_not_is_not() -> None:
    clock, written = Clock(), [1000]
    end = ending(clock)
    end.watch_recorder(lambda: written[0])
    end.begin()
    for _ in range(20):
        clock.now_s += 0.5
        written[0] += 1
        assert not end.overdue()
    clock.now_s += 1.01
    assert end.overdue()


def test_a_hanging_step_is_abandoned_once() -> None:
    clock = Clock()
    reported: list[str] = []
    end = Shutdown(lambda: True, force_exit=reported.append, clock=clock)
    end.begin()
    clock.now_s += 3.1
    end.watch()
    assert wait_until(lambda: bool(reported), 10.0)
    assert reported[0].startswith("did not end within 3 s")
    assert len(reported) == 1


def test_an_ended_step_is_not_abandoned() -> None:
    clock = Clock()
    reported: list[str] = []
    end = Shutdown(lambda: True, force_exit=reported.append, clock=clock)
    end.watch()
    end.done()
    clock.now_s += 100.0
    assert not wait_until(lambda: bool(reported), 0.3)


def test_restarts_are_ever_further_apart_up_to_eight_seconds() -> None:
    delay = RestartDelay()
    delay.began(0.0)
    assert [delay.lost(t) - t for t in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)] == [0.0, 1.0, 2.0, 4.0, 8.0, 8.0, 8.0]
    assert delay.restarts == 7
    delay.began(20.0)
    assert delay.lost(79.0) == 87.0
    # a minute without trouble
    delay.began(100.0)
    assert delay.lost(161.0) == 161.0


def test_a_child_that_is_stopped_is_killed() -> None:
    """Expected: SIGTERM waits for a stopped process to continue; no `join` without a bound waits with it."""
    child = ChildProcess("stopped", wait_for_word)
    assert child.pipe.poll(60.0)
    os.kill(child.pid, signal.SIGSTOP)
    assert not child.end("stop", 0.1, 0.1)
    assert not child.is_alive()
    assert child.exit_description() == "was ended by SIGKILL"


def test_a_child_that_does_not_listen_is_killed_and_one_that_does_is_not() -> None:
    deaf, good = ChildProcess("deaf", ignore_everything), ChildProcess("good", wait_for_word)
    assert deaf.pipe.poll(60.0)
    assert good.pipe.poll(60.0)
    assert not deaf.end("stop", 0.1, 0.1)
    assert deaf.exit_description() == "was ended by SIGKILL"
    assert good.end("stop", 60.0, 0.1)
    assert good.exit_description() == "ended with exit code 0"
    assert not good.send("anything")


def test_a_child_is_requested_to_end_before_it_is_killed() -> None:
    others = set(mp.active_children())
    child = ChildProcess("asked", wait_for_word)
    assert child.pipe.poll(60.0)
    assert child.end("nothing that it knows", 60.0, 60.0)
    assert set(mp.active_children()) <= others


@pytest.fixture
def station(tmp_path: Path) -> Iterator[tuple[Run, Units]]:
    """A whole station in operation on units that a process of its own serves."""
    units = Units(tmp_path)
    run = Run(tmp_path, tmp_path / "run")
    try:
        assert wait_until(lambda: run.ready(0.0) < float("inf"), 240.0), (run.run / "said.txt").read_text()
        yield run, units
    finally:
        run.kill()
        units.stop()


def test_ctrl_c_while_the_ptus_process_is_stopped(station: tuple[Run, Units]) -> None:
    """Expected: it ends, with exit code 1 and a line; the heads stand; the recording is whole to the end."""
    run, units = station
    began_s = time.monotonic()
    os.kill(run.pids()["ptus"], signal.SIGSTOP)
    newest = run.statuses()[-1]
    took_s, code = run.end()
    # the bound itself is checked on a simulated clock; a busy machine takes what it takes
    assert took_s < 45.0
    assert code == 1
    reported = (run.run / "said.txt").read_text(encoding="utf-8")
    assert "the PTUs' process" in reported
    assert "was killed" in reported
    assert "Traceback" not in reported
    # a halt that is acknowledged brakes for up to half a second
    time.sleep(0.5)
    now_s = time.monotonic()
    assert max(units.stood(began_s, now_s).values()) < float("inf")
    assert max(units.turned(now_s - 0.2, now_s).values()) == 0.0
    assert recorded_until(run.run / "live" / "flight.mcap") > newest[1] - 1.0


def test_a_killed_pipeline_leaves_no_head_turning_and_a_recording(station: tuple[Run, Units]) -> None:
    run, units = station
    begun = len(run.statuses())
    # some chunks of the recording are closed by then
    assert wait_until(lambda: len(run.statuses()) > begun + 8, 60.0)
    began_s = time.monotonic()
    newest = run.statuses()[-1]
    os.kill(run.process.pid, signal.SIGKILL)
    assert wait_until(lambda: max(units.stood(began_s, time.monotonic()).values()) < float("inf"), 30.0)
    time.sleep(0.5)
    now_s = time.monotonic()
    assert max(units.turned(now_s - 0.2, now_s).values()) == 0.0
    # a quarter of a second, where the machine lets the recorder write; the study has the figures
    assert recorded_until(run.run / "live" / "flight.mcap") > newest[1] - 5.0


def test_a_pipe_that_is_closed_under_a_sender_is_no_error() -> None:
    """Expected: who commands and who supervises are two threads; a command to a process that is being lost is lost."""
    for _ in range(3):
        child = ChildProcess("short", wait_for_word)
        assert child.pipe.poll(60.0)
        faults: list[BaseException] = []

        def send(to: ChildProcess = child, into: list[BaseException] = faults) -> None:
            try:
                while to.send("x" * 1000):
                    pass
            except BaseException as fault:  # noqa: BLE001 - whatever it is, the test fails by it
                into.append(fault)

        threads = [threading.Thread(target=send) for _ in range(4)]
        for thread in threads:
            thread.start()
        child.kill()
        for thread in threads:
            thread.join()
        assert faults == []
