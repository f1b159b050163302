"""Thread scheduling: a thread of lowered priority does not delay the others."""

import os
import sys
import threading

import pytest

from groundstation.thread_scheduling import give_way, short_gil_switch_interval


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only on Linux a thread has a rank of its own")
def test_a_thread_lowers_its_own_priority() -> None:
    before = os.getpriority(os.PRIO_PROCESS, 0)
    seen: list[tuple[bool, int]] = []
    thread = threading.Thread(target=lambda: seen.append((give_way(), os.getpriority(os.PRIO_PROCESS, 0))))
    thread.start()
    thread.join()
    assert seen == [(True, min(before + 5, 19))]
    assert os.getpriority(os.PRIO_PROCESS, 0) == before


def test_without_thread_priorities_nothing_is_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: int) -> None:
        raise PermissionError("not here")

    monkeypatch.setattr(os, "setpriority", refused)
    assert not give_way()
    monkeypatch.setattr(sys, "platform", "win32")
    assert not give_way()


def test_the_interpreters_switch_interval_is_restored() -> None:
    before_s = sys.getswitchinterval()
    with short_gil_switch_interval():
        assert sys.getswitchinterval() < before_s
    assert sys.getswitchinterval() == before_s
