"""Ctrl-C while the program is still being read."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import groundstation.cli.main
from groundstation.cli.start import ONE_THREAD, main

ROOT = Path(__file__).resolve().parents[2]
# the import of the command line is interrupted
INTERRUPTED = """
import sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "groundstation.cli.main":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Finder())
from groundstation.cli.start import main
sys.exit(main())
"""
# a command that multiplies matrices large enough to share, and then prints the number of threads
MULTIPLYING = """
import os, sys, types
cli = sys.modules["groundstation.cli.main"] = types.ModuleType("groundstation.cli.main")
def run():
    import numpy as np
    np.ones((400, 400)) @ np.ones((400, 400))
    print(len(os.listdir("/proc/self/task")), os.environ["OPENBLAS_NUM_THREADS"])
    return 0
cli.main = run
from groundstation.cli.start import main
sys.exit(main())
"""


@pytest.fixture(autouse=True)
def own_handler() -> Iterator[None]:
    """Give the tests' process its handler back: at its end the program ignores interrupts."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


def test_interrupted_while_it_is_read_it_ends_quietly() -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "groundstation: interrupted\n")


def test_interrupted_in_a_text_that_is_executed_its_exit_code_counts(tmp_path: Path) -> None:
    """Expected: 130 of `python -m`, too, which otherwise ends by the signal, as where a dataclass is being made."""
    program = INTERRUPTED.replace("raise KeyboardInterrupt", 'exec("raise KeyboardInterrupt")')
    (tmp_path / "interrupted_start.py").write_text(program, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "interrupted_start"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "groundstation: interrupted\n")


def test_what_is_imported_before_it_stands_ready_is_its_own() -> None:
    """An interrupt within an import of Python's library would end in a traceback: there is none."""
    program = "import sys; known = set(sys.modules); import groundstation.cli.start; print(*set(sys.modules) - known)"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {"groundstation", "groundstation.cli", "groundstation.cli.start"}


def test_else_it_is_the_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(groundstation.cli.main, "main", lambda: 7)
    assert main() == 7


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in /proc")
@pytest.mark.parametrize("reported", [None, "2"])
def test_linear_algebra_uses_one_thread_unless_set_by_the_user(reported: str | None) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}
    environment |= {} if reported is None else {"OPENBLAS_NUM_THREADS": reported}
    done = subprocess.run(
        [sys.executable, "-c", MULTIPLYING], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    threads, kept = done.stdout.split()
    assert kept == (reported or "1")
    assert reported is not None or threads == "1"
