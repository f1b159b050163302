"""The end of the process while a thread runs that its command has left."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# a command that writes when its exit function runs and when the interpreter is taken apart
PROGRAM = """
import atexit, builtins, sys, threading, time, types
class Kept:
    def __del__(self, print=print):
        print("taken apart", flush=True)
builtins.kept = Kept()
threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
cli = sys.modules["groundstation.cli.main"] = types.ModuleType("groundstation.cli.main")
def run():
    atexit.register(print, "exit function")
    {command}
cli.main = run
from groundstation.cli.start import main
sys.exit(main())
"""
LEFT = "threading.Thread(target=time.sleep, args=(60,), daemon=True).start()"


def _run(command: str) -> "subprocess.CompletedProcess[str]":
    program = PROGRAM.format(command=command)
    return subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=30, check=False
    )


@pytest.mark.parametrize(("ends", "code"), [("return 3", 3), ("raise KeyboardInterrupt", 130)])
def test_with_a_thread_left_the_interpreter_is_not_taken_apart(ends: str, code: int) -> None:
    """A thread within OpenCV aborts the process in that: exit by SIGABRT after a correct output."""
    done = _run(f"{LEFT}; {ends}")
    assert (done.returncode, done.stdout) == (code, "exit function\n")


def test_without_one_it_is() -> None:
    """A thread that ran before the command makes no difference."""
    done = _run("return 3")
    assert (done.returncode, done.stdout) == (3, "exit function\ntaken apart\n")


def test_output_that_a_full_disk_does_not_take_is_no_success() -> None:
    """Expected: exit code 120, as of the interpreter's own end."""
    program = PROGRAM.format(command=f"{LEFT}; return 0")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-c", program],
            cwd=ROOT, env=environment, stdout=full, stderr=subprocess.PIPE, timeout=30, check=False,
        )  # fmt: skip
    assert done.returncode == 120
