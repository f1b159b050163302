"""After the warm-up nothing of weight is left to compile: a replay does not wait for a compiler."""

import subprocess
import sys
from pathlib import Path

_PROGRAM = """
import gc, sys
from pathlib import Path
from groundstation.tracking.warm_up import warm_up
from groundstation.replay.replay import ReplayRequest, replay
from numba.core.registry import CPUDispatcher

def compiled():
    kernels = [f for f in gc.get_objects() if isinstance(f, CPUDispatcher) and f.signatures]
    names = {(f.py_func.__module__, f.py_func.__name__) for f in kernels}
    return {name for name in names if name[0].startswith("groundstation")}

warm_up()
before = compiled()
replay(ReplayRequest(session=Path(sys.argv[1]), out=Path(sys.argv[2]), to_s=6.0, rerun=False, report=False))
print(sorted(compiled() - before), 'scipy.stats' in sys.modules)
"""


def test_no_kernel_is_first_compiled_during_a_replay(landing_1: Path, tmp_path: Path) -> None:
    """In a process of its own: the first six seconds, with the search, use only kernels that are warm.

    Nor is `scipy.stats` imported, which takes half a second of a core (`groundstation.geometry.chi_square`).
    """
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, str(landing_1), str(tmp_path / "out")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip().splitlines()[-1] == "[] False"
