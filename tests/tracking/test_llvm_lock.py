"""LLVM's lock without numba's events: kernels compile and run, and no event is built."""

import subprocess
import sys

import pytest

_PROGRAM = """
import sys
from numba import njit
from numba.core.event import install_recorder
from groundstation.tracking.llvm_lock import drop_lock_events

if sys.argv[1] == "dropped":
    drop_lock_events()
    drop_lock_events()
with install_recorder("numba:llvm_lock") as recorded:
    assert njit(lambda x: x + 1)(2) == 3
print(len(recorded.buffer))
"""


@pytest.mark.parametrize("how", ["dropped", "as numba has it"])
def test_a_kernel_compiles_without_an_event_of_the_lock(how: str) -> None:
    """Expected: none, where numba by itself builds some (how many differs by version); a second call drops nothing."""
    done = subprocess.run([sys.executable, "-c", _PROGRAM, how], capture_output=True, text=True, check=True)
    events = int(done.stdout)
    assert events == 0 if how == "dropped" else events > 0


def test_events_that_were_asked_for_stay() -> None:
    """Expected: with a trace file of numba's own they are all there."""
    program = f"from numba.core import config\nconfig.CHROME_TRACE = 'trace.json'\n{_PROGRAM}"
    done = subprocess.run([sys.executable, "-c", program, "dropped"], capture_output=True, text=True, check=True)
    assert int(done.stdout) > 0
