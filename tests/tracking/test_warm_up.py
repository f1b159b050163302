"""After the warm-up nothing of weight is left to compile: a replay does not wait for a compiler."""

import subprocess
import sys
from pathlib import Path

import pytest

from groundstation.detection.config import DetectorKind

_PROGRAM = """
import gc, sys
from pathlib import Path
from groundstation.detection.config import DetectorKind
from groundstation.tracking.warm_up import warm_up
from groundstation.replay.replay import ReplayRequest, replay
from numba.core.registry import CPUDispatcher

def compiled():
    kernels = [f for f in gc.get_objects() if isinstance(f, CPUDispatcher) and f.signatures]
    names = {(f.py_func.__module__, f.py_func.__name__) for f in kernels}
    return {name for name in names if name[0].startswith("groundstation")}

config = Path(sys.argv[2]).with_suffix(".toml")
config.write_text(f'[detection]\\ndetector = "{sys.argv[3]}"\\n')
warm_up(DetectorKind(sys.argv[3]))
before = compiled()
paths = {"session": Path(sys.argv[1]), "out": Path(sys.argv[2]), "config": config}
replay(ReplayRequest(**paths, from_s=20.0, to_s=22.2, rerun=False, report=False))
assert 'tracking' in Path(sys.argv[2], 'track.csv').read_text()
print(sorted(compiled() - before), 'scipy.stats' in sys.modules)
"""


@pytest.mark.parametrize("kind", list(DetectorKind))
def test_no_kernel_is_first_compiled_during_a_replay(
    kind: DetectorKind, landing_from_20_s: Path, tmp_path: Path
) -> None:
    """In a process of its own: two seconds, of search and of a track, use only kernels that are warm.

    Nor is `scipy.stats` imported, which takes half a second of a core (`groundstation.geometry.chi_square`).
    """
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, str(landing_from_20_s), str(tmp_path / "out"), kind],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip().splitlines()[-1] == "[] False"
