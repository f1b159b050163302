"""Pictures that are let go leave no trace, whatever lies between them."""

import subprocess
import sys
from pathlib import Path

from tests.kept_memory import usual_environment

ROOT = Path(__file__).resolve().parents[2]
# the first picture of all initialises the allocator; of the rest only the last stays
PROGRAM = """
import sys
import numpy as np
from groundstation.live.memory import configure_allocator

def resident_mb():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

if sys.argv[1] == "settled":
    assert configure_allocator()
np.ones(1_200_000, np.uint8)
before = resident_mb()
pictures = [np.ones(1_200_000, np.uint8) for _ in range(100)]
del pictures[:-1]
print(resident_mb() - before)
"""


def test_pictures_that_are_let_go_give_their_memory_back() -> None:
    grown = {}
    for how in ("settled", "as it is"):
        run = subprocess.run(
            [sys.executable, "-c", PROGRAM, how],
            cwd=ROOT,
            env=usual_environment(),
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        )
        grown[how] = float(run.stdout)
    assert grown["settled"] < 5.0
    # else there is nothing to settle
    assert grown["as it is"] > 50.0
