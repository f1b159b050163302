"""Leases that expire, halts that are repeated until acknowledged, and a guard that outlives its client."""

import multiprocessing as mp
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from ptu_drivers.emergency_halt import HaltLine
from ptu_drivers.errors import NoAnswerError
from ptu_drivers.messages import Axis
from ptu_drivers.motion_guard import (
    HALTING_S,
    LEASE_S,
    ExpiredLeases,
    GuardReport,
    HaltingThread,
    MemoryReserve,
    MotionLeases,
    serve_guard,
)
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco
from ptu_drivers.simulated.server import SimulatedServer

LINE = HaltLine(url="nowhere")


def until(condition: Callable[[], bool], seconds: float = 30.0) -> bool:
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        if condition():
            return True
        time.sleep(0.01)
    return False


def test_a_lease_that_runs_out_is_acted_on_once() -> None:
    leases = MotionLeases(("left", "right"))
    expiry = ExpiredLeases(leases)
    assert expiry.expired(100.0) == ()
    leases.renew("left", 10.0)
    leases.renew("right", 20.0)
    assert expiry.pending()
    assert expiry.expired(9.99) == expiry.expired(10.0) == ()
    # the second successive check with that result
    assert expiry.expired(10.01) == ()
    assert expiry.expired(10.03) == ("left",)
    assert expiry.expired(10.05) == ()
    assert expiry.pending()
    leases.release("right")
    assert not expiry.pending()
    assert expiry.expired(99.0) == ()


def test_a_lease_that_is_renewed_in_between_is_in_force() -> None:
    leases = MotionLeases(("left",))
    expiry = ExpiredLeases(leases)
    leases.renew("left", 10.0)
    assert expiry.expired(10.1) == ()
    leases.renew("left", 10.5)
    assert expiry.expired(10.2) == ()
    assert expiry.expired(10.6) == ()
    assert expiry.expired(10.7) == ("left",)
    # and each time again
    leases.renew("left", 11.0)
    assert [expiry.expired(t) for t in (10.9, 11.1, 11.2, 11.3)] == [(), (), ("left",), ()]


def test_beats_and_leases_do_not_share_their_places() -> None:
    leases = MotionLeases(("left", "right"))
    leases.set_guard_heartbeat(1.0)
    leases.set_driver_heartbeat(2.0)
    leases.renew("left", 3.0)
    leases.renew("right", 4.0)
    values = (leases.guard_heartbeat_s, leases.driver_heartbeat_s, leases.until_s("left"), leases.until_s("right"))
    assert values == (1.0, 2.0, 3.0, 4.0)
    leases.release("left")
    assert (leases.until_s("left"), leases.until_s("right")) == (0.0, 4.0)


def test_a_halt_is_tried_until_it_is_acknowledged() -> None:
    tries: list[int] = []
    reports: list[GuardReport] = []

    def attempt(line: HaltLine, number: int) -> None:
        tries.append(number)
        if number < 2:
            raise NoAnswerError("halt", waited_s=0.1, got="nothing")
        if number > 2:
            raise RuntimeError("tried once too often")

    thread = HaltingThread("left", LINE, reports.append, attempt=attempt)
    thread.request()
    assert until(lambda: bool(reports))
    assert tries == [0, 1, 2]
    assert reports[0].acknowledged
    assert until(lambda: not thread.busy)


@pytest.mark.parametrize("fault", [NoAnswerError("halt", waited_s=0.1, got="nothing"), RuntimeError("a fault of ours")])
def test_a_halt_that_nobody_acknowledges_is_reported_as_that(fault: Exception) -> None:
    """Expected: after the time for it, on a clock that advances with each attempt, with the last reason."""
    reports: list[GuardReport] = []
    now_s = [0.0]

    def attempt(line: HaltLine, number: int) -> None:
        now_s[0] += HALTING_S / 4
        raise fault

    HaltingThread("left", LINE, reports.append, attempt=attempt, clock=lambda: now_s[0]).request()
    assert until(lambda: bool(reports))
    assert not reports[0].acknowledged
    assert str(fault) in reports[0].why
    assert reports[0].ended_s == HALTING_S


def test_the_lines_address_is_resolved_once_and_ahead() -> None:
    found, tried = threading.Event(), queue.Queue[str]()

    def find(line: HaltLine) -> HaltLine:
        assert not found.is_set()
        found.set()
        return replace(line, url="socket://192.0.2.7:4000")

    thread = HaltingThread("left", LINE, lambda report: None, attempt=lambda line, k: tried.put(line.url), find=find)
    assert found.wait(10.0)
    for _ in range(2):
        thread.request()
        assert tried.get(timeout=10.0) == "socket://192.0.2.7:4000"


def test_memory_reserved_for_a_halt_is_free_during_one() -> None:
    reserve, free = MemoryReserve(1000), queue.Queue[bool]()
    assert reserve.held
    reports = queue.Queue[GuardReport]()
    thread = HaltingThread("left", LINE, reports.put, attempt=lambda *_: free.put(not reserve.held), reserve=reserve)
    for _ in range(2):
        thread.request()
        assert free.get(timeout=10.0)
        assert reports.get(timeout=10.0).acknowledged
        while thread.busy or not reserve.held:
            time.sleep(0.001)


def test_memory_stays_free_until_the_last_of_several_halts_has_ended() -> None:
    reserve = MemoryReserve(1000)
    reserve.release()
    reserve.release()
    reserve.hold()
    assert not reserve.held
    reserve.hold()
    assert reserve.held


def test_without_memory_to_reserve_the_guard_continues() -> None:
    assert not MemoryReserve(1 << 60).held


def test_a_request_during_a_halt_is_another_halt() -> None:
    """Expected: what was commanded after the first began is halted, too."""
    begun, go_on = threading.Event(), threading.Event()
    reports: list[GuardReport] = []

    def attempt(line: HaltLine, number: int) -> None:
        begun.set()
        go_on.wait(10.0)

    thread = HaltingThread("left", LINE, reports.append, attempt=attempt)
    thread.request()
    assert begun.wait(10.0)
    thread.request()
    go_on.set()
    assert until(lambda: len(reports) == 2)
    assert reports[1].began_s >= reports[0].ended_s


@pytest.mark.parametrize("orphaned", [False, True])
def test_a_guard_halts_units_with_expired_leases(tmp_path: Path, orphaned: bool) -> None:
    """Expected: by the lease alone, without a request; a guard without clients then ends."""
    unit = SimulatedPelco(PelcoModel(baud=9600))
    link = tmp_path / "ptu"
    with SimulatedServer(VirtualLine(unit, 9600, start_s=time.monotonic()), link) as server:

        def turns() -> bool:
            with server.lock:
                return unit.axes[Axis.PAN].speed(time.monotonic()) != 0.0

        with server.lock:
            unit.axes[Axis.PAN].move_at(time.monotonic(), 300.0)
        leases = MotionLeases(("left",))
        context = mp.get_context("spawn")
        ours, other = context.Pipe()
        line = HaltLine(url=str(link), protocol="pelco-d", options={"speeds_deg_s": {8: 5.0}})
        guard = context.Process(target=serve_guard, args=({"left": line}, leases, other), daemon=True)
        guard.start()
        other.close()
        try:
            assert until(lambda: leases.guard_heartbeat_s > 0.0)
            for _ in range(10):
                leases.renew("left", time.monotonic() + 5.0)
                time.sleep(0.05)
            assert turns()
            leases.renew("left", time.monotonic() + LEASE_S)
            if orphaned:
                ours.close()
            assert until(lambda: not turns())
            if orphaned:
                guard.join(30.0)
                assert guard.exitcode == 0
            else:
                assert ours.poll(30.0)
                assert ours.recv().acknowledged
                ours.send("stop")
                guard.join(30.0)
                assert guard.exitcode == 0
        finally:
            guard.kill()
            guard.join()
            ours.close()
