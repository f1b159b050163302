"""Several processes that need one kernel compile it once between them."""

import subprocess
import sys
from pathlib import Path

_MODULE = """
from numba import njit

@njit(cache=True)
def inner(x):
    return x * x

@njit(cache=True)
def outer(x):
    return inner(x) + 1.0
"""
_PROGRAM = """
import sys
from tests.compile_once import compile_once
compile_once()
from numba.core import event
compiled = []

class Listener(event.Listener):
    def on_start(self, heard):
        compiled.append(heard.data["dispatcher"].py_func.__name__)

    def on_end(self, heard):
        pass

event.register("numba:compile", Listener())
sys.path.insert(0, sys.argv[1])
import kernels_of_two
print("ready", flush=True)
sys.stdin.readline()
assert kernels_of_two.outer(3.0) == 10.0
print(*compiled)
"""


def test_two_processes_compile_a_kernel_once(tmp_path: Path) -> None:
    (tmp_path / "kernels_of_two.py").write_text(_MODULE)
    command = [sys.executable, "-c", _PROGRAM, str(tmp_path)]
    both = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    for process in both:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in both:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    reported = [process.communicate(timeout=120)[0].split() for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert sorted(name for names in reported for name in names) == ["inner", "outer"]
