"""Who gets a unit's line: a halt before all else, each other call in turn, and a call within a call at once."""

import threading
import time

import pytest

from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason
from ptu_drivers.line_lock import LineLock


def wait_until(holds: "threading.Event | None" = None, *, lock: LineLock | None = None) -> None:
    limit = time.monotonic() + 60.0
    while not (holds.is_set() if holds else lock is not None and lock.is_preempted):
        assert time.monotonic() < limit
        time.sleep(0.001)


def test_a_halt_is_admitted_before_longer_waiting_threads() -> None:
    lock, order = LineLock(), []
    started = [threading.Event() for _ in range(5)]

    def read(k: int) -> None:
        started[k].set()
        with lock:
            order.append("read")

    def halt() -> None:
        with lock.for_halt():
            order.append("halt")

    with lock:
        readers = [threading.Thread(target=read, args=(k,)) for k in range(5)]
        for k, reader in enumerate(readers):
            reader.start()
            wait_until(started[k])
        assert not lock.is_preempted
        halting = threading.Thread(target=halt)
        halting.start()
        wait_until(lock=lock)
        with pytest.raises(ExchangeFailed) as caught:
            lock.raise_if_preempted()
        assert caught.value.reason is FailureReason.PREEMPTED
    for thread in (*readers, halting):
        thread.join(60.0)
    assert order == ["halt", *["read"] * 5]


def test_a_halt_is_not_preempted_by_another_one() -> None:
    lock, entered = LineLock(), threading.Event()

    def halt() -> None:
        entered.set()
        with lock.for_halt():
            pass

    with lock.for_halt():
        # a call within the halt does not make it less of one
        with lock:
            other = threading.Thread(target=halt)
            other.start()
            wait_until(entered)
            time.sleep(0.05)
            assert not lock.is_preempted
            lock.raise_if_preempted()
        lock.raise_if_preempted()
    other.join(60.0)
    assert not other.is_alive()
