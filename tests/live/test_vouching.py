"""Whom the PTUs' process vouches for, and when it holds heads still: a simulated clock, stand-ins for threads."""

import contextlib
import math
import multiprocessing as mp
from types import SimpleNamespace
from typing import cast

import pytest

from groundstation.live.head_process import (
    _PipeSink,
    _serve,
    renew_leases,
    state_text,
    stop_and_release,
    unresponsive_heads,
)
from groundstation.live.head_worker import HeadWorker
from ptu_drivers.health import HealthCounter, UnitState
from ptu_drivers.motion_guard import LEASE_S, MotionLeases

REPLY_S = 0.6


class Thread:
    """A head's thread that came round at a stated time."""

    def __init__(self, last_cycle_s: float) -> None:
        self.last_cycle_s = last_cycle_s
        self.held: bool | None = None
        self.ended = False
        self.health = HealthCounter(state=UnitState.READY).snapshot()
        self.unit = SimpleNamespace(describe=lambda: SimpleNamespace(reply_timeout_s=REPLY_S))

    def set_hold(self, held: bool) -> None:
        self.held = held


def vouched(leases: MotionLeases, threads: dict[str, Thread], now_s: float) -> None:
    renew_leases(cast(dict[str, HeadWorker], threads), leases, now_s)


def test_a_hanging_thread_loses_its_lease_and_no_other() -> None:
    leases = MotionLeases(("left", "right"))
    threads = {"left": Thread(100.0), "right": Thread(100.0)}
    leases.set_guard_heartbeat(100.0)
    vouched(leases, threads, 100.0)
    assert (leases.until_s("left"), leases.until_s("right")) == (100.0 + LEASE_S, 100.0 + LEASE_S)
    assert leases.driver_heartbeat_s == 100.0
    threads["right"].last_cycle_s = 102.0
    vouched(leases, threads, 102.0)
    assert leases.until_s("left") == 100.0 + LEASE_S
    assert leases.until_s("right") == 102.0 + LEASE_S
    assert leases.driver_heartbeat_s == 102.0


def test_a_thread_may_wait_as_long_as_its_unit_may_take() -> None:
    leases = MotionLeases(("left",))
    vouched(leases, {"left": Thread(100.0)}, 100.0 + REPLY_S + LEASE_S - 0.01)
    assert leases.until_s("left") > 0.0
    leases.release("left")
    vouched(leases, {"left": Thread(100.0)}, 100.0 + REPLY_S + LEASE_S + 0.01)
    assert leases.until_s("left") == 0.0


def test_without_a_guard_all_are_held() -> None:
    leases = MotionLeases(("left", "right"))
    threads = {"left": Thread(100.0), "right": Thread(100.0)}
    # none has ever reported that it is alive
    vouched(leases, threads, 100.0)
    assert [t.held for t in threads.values()] == [True, True]
    leases.set_guard_heartbeat(100.0)
    vouched(leases, threads, 100.0 + LEASE_S)
    assert [t.held for t in threads.values()] == [False, False]
    vouched(leases, threads, 100.01 + LEASE_S)
    assert [t.held for t in threads.values()] == [True, True]


class Shutdown:
    """A head's thread that is stopped, and what comes of it."""

    def __init__(self, acknowledged: bool | BaseException) -> None:
        self._acknowledged = acknowledged

    def stop(self) -> bool:
        if isinstance(self._acknowledged, BaseException):
            raise self._acknowledged
        return self._acknowledged


@pytest.mark.parametrize(("acknowledged", "left_s"), [(True, 0.0), (False, 7.0), (SystemExit(143), 7.0)])
def test_a_lease_is_given_back_only_after_an_acknowledged_halt(
    acknowledged: bool | BaseException, left_s: float
) -> None:
    """Expected: no acknowledgement, or a SIGTERM while it is waited for: the lease runs out, and the guard halts."""
    leases = MotionLeases(("left",))
    leases.renew("left", 7.0)
    with contextlib.suppress(SystemExit):
        stop_and_release("left", cast(HeadWorker, Shutdown(acknowledged)), leases)
    assert leases.until_s("left") == left_s


def test_a_thread_that_ended_is_vouched_for_no_more_and_its_head_is_lost() -> None:
    """Expected: at once, though it came round a moment ago, and though its last health was that all is well."""
    leases = MotionLeases(("left", "right"))
    threads = {"left": Thread(100.0), "right": Thread(100.0)}
    threads["left"].ended = True
    vouched(leases, threads, 100.0)
    assert (leases.until_s("left"), leases.until_s("right")) == (0.0, 100.0 + LEASE_S)
    assert unresponsive_heads(cast(dict[str, HeadWorker], threads), 100.0) == ["left: PTU: its thread has ended"]
    assert state_text(cast(HeadWorker, threads["left"]), 100.0) == "thread ended"
    assert state_text(cast(HeadWorker, threads["right"]), 100.0) == "ready"


def test_a_driver_that_does_not_return_is_not_ready_and_then_lost() -> None:
    """Expected: not ready as soon as its lease ends; lost once it takes longer than a halt and a reading may."""
    thread = Thread(100.0)
    threads = cast(dict[str, HeadWorker], {"left": thread})
    late_s = 100.0 + REPLY_S + LEASE_S + 0.01
    assert state_text(cast(HeadWorker, thread), late_s) == "driver does not return"
    assert unresponsive_heads(threads, late_s) == []
    assert unresponsive_heads(threads, 100.0 + 4 * REPLY_S + 0.99) == []
    assert unresponsive_heads(threads, 100.0 + 4 * REPLY_S + 1.01) == [
        "left: PTU: its driver has not returned for 3.4 s"
    ]


def test_a_thread_that_has_not_started_is_not_lost() -> None:
    assert unresponsive_heads(cast(dict[str, HeadWorker], {"left": Thread(math.inf)}), 100.0) == []


def test_the_process_ends_with_a_loss_when_a_thread_has_ended() -> None:
    """Expected: without a request, and with the reason first."""
    here, there = mp.Pipe()
    leases, thread = MotionLeases(("left",)), Thread(math.inf)
    thread.ended = True
    assert _serve(there, cast(dict[str, HeadWorker], {"left": thread}), _PipeSink(there), leases)
    assert here.poll(0)
    assert here.recv() == "left: PTU: its thread has ended"
    assert leases.until_s("left") == 0.0
