"""When a silent process is killed: by its state in the system."""

import os
import signal
import subprocess
import sys
import time

import pytest

from groundstation.live.hang_detector import ASLEEP_S, LONGEST_S, HangDetector, ProcessActivity, activity
from ptu_drivers.motion_guard import LEASE_S


@pytest.mark.parametrize(
    ("state", "advancing", "bound_s"),
    [
        ("T", False, LEASE_S),
        ("S", False, ASLEEP_S),
        ("D", False, ASLEEP_S),
        # other threads keep the interpreter
        ("S", True, LONGEST_S),
        # ready, and not given a processor
        ("R", False, LONGEST_S),
        ("R", True, LONGEST_S),
        # the system does not report it
        ("", False, LONGEST_S),
    ],
)
def test_limit_of_a_process_silence(state: str, advancing: bool, bound_s: float) -> None:
    ticks = 0

    def look(_pid: int) -> ProcessActivity:
        nonlocal ticks
        ticks += advancing
        return ProcessActivity(state=state, ticks=ticks)

    silence = HangDetector(look)
    silent_s = 0.0
    while not silence.hangs(7, silent_s):
        silent_s += 0.01
    assert silent_s == pytest.approx(bound_s, abs=0.011)
    assert silent_s > bound_s


def test_a_process_heard_again_resets_its_delay() -> None:
    """Expected: what it did before its last sign of life does not count as activity since."""
    ticks = [5]
    silence = HangDetector(lambda _: ProcessActivity(state="S", ticks=ticks[0]))
    assert not silence.hangs(7, 0.4)
    ticks[0] = 9
    assert not silence.hangs(7, 0.1)
    assert not silence.hangs(7, 0.4)
    assert silence.hangs(7, ASLEEP_S + 0.01)


def test_the_activity_of_a_true_process() -> None:
    """Expected: stopped is seen as stopped, work as processor time, and none is no error."""
    child = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        end_s = time.monotonic() + 60.0
        while activity(child.pid).ticks < 2 and time.monotonic() < end_s:
            time.sleep(0.02)
        assert activity(child.pid).ticks >= 2
        os.kill(child.pid, signal.SIGSTOP)
        while activity(child.pid).state != "T" and time.monotonic() < end_s:
            time.sleep(0.02)
        assert activity(child.pid).state == "T"
    finally:
        child.kill()
        child.wait()
    assert activity(child.pid) == ProcessActivity(state="", ticks=0)
