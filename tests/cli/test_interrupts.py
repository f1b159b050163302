"""Interrupts at moments at which Python would lose them, or print a traceback."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# a command line whose command is given
AROUND = """
import signal, sys, time, types
cli = sys.modules["groundstation.cli.main"] = types.ModuleType("groundstation.cli.main")
class Interrupting:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
        time.sleep(0)
def run():
    {command}
cli.main = run
from groundstation.cli.start import main
sys.exit(main())
"""
IN_A_DESTRUCTOR = """
    Interrupting()
    time.sleep(20)
    return 0
"""
TERMINATED_IN_A_DESTRUCTOR = """
    from groundstation.cli.terminated import TERMINATED, Terminated, ended_in_order
    class Terminating:
        def __del__(self):
            signal.raise_signal(signal.SIGTERM)
            time.sleep(0)
    try:
        with ended_in_order():
            Terminating()
            time.sleep(20)
    except Terminated:
        return TERMINATED
    return 0
"""
TERMINATED_WITHIN_LLVM = """
    from groundstation.cli.terminated import TERMINATED, Terminated, ended_in_order
    space = {"__name__": "llvmlite.binding.a_test", "signal": signal, "time": time}
    exec("def make():\\n signal.raise_signal(signal.SIGTERM)\\n time.sleep(0.1)\\n print('made')", space)
    try:
        with ended_in_order():
            space["make"]()
            time.sleep(20)
    except Terminated:
        return TERMINATED
    return 0
"""
AS_ANOTHER_ERROR = """
    try:
        signal.raise_signal(signal.SIGINT)
        time.sleep(0)
    except KeyboardInterrupt:
        raise ImportError("a module that could not be read") from None
"""
# as a library's object whose constructor takes a handle; one is destroyed by Python's own end
HALF_MADE = """
    import builtins
    class Handle:
        def __init__(self):
            {raised}
            self.number = 1
        def __del__(self):
            del self.number
    builtins.kept = Handle.__new__(Handle)
    Handle()
    return 0
"""
# the frames of a library whose objects are not to be left half made
WITHIN_LLVM = """
    space = {"__name__": "llvmlite.binding.a_test", "signal": signal, "time": time}
    exec("def make():\\n signal.raise_signal(signal.SIGINT)\\n time.sleep(0.1)\\n print('made')", space)
    space["make"]()
    time.sleep(20)
    return 0
"""
AT_THE_END = """
    import atexit
    atexit.register(signal.raise_signal, signal.SIGINT)
    return 0
"""
OF_ITS_OWN = """
    raise ValueError("a fault of the program")
"""


pytestmark = pytest.mark.usefixtures("interrupts_heard")


def _run(command: str) -> "subprocess.CompletedProcess[str]":
    program = AROUND.format(command=command.strip())
    return subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("command", [IN_A_DESTRUCTOR, AS_ANOTHER_ERROR])
def test_an_interrupt_is_never_lost_and_no_traceback(command: str) -> None:
    done = _run(command)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "groundstation: interrupted\n")


def test_what_an_interrupt_leaves_half_made_is_destroyed_without_a_word() -> None:
    done = _run(HALF_MADE.format(raised="signal.raise_signal(signal.SIGINT); time.sleep(0)"))
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "groundstation: interrupted\n")


def test_an_interrupt_within_llvm_comes_when_it_is_left() -> None:
    done = _run(WITHIN_LLVM)
    assert (done.returncode, done.stdout, done.stderr) == (130, "made\n", "groundstation: interrupted\n")


def test_a_termination_within_llvm_comes_when_it_is_left() -> None:
    done = _run(TERMINATED_WITHIN_LLVM)
    assert (done.returncode, done.stdout, done.stderr) == (143, "made\n", "")


def test_what_a_destructor_misses_without_an_interrupt_is_reported() -> None:
    done = _run(HALF_MADE.format(raised="return"))
    assert done.returncode == 0
    assert done.stderr.count("AttributeError") == 2


def test_a_termination_that_would_be_lost_comes_again_as_one() -> None:
    """Expected: its own exit code, not that of Ctrl-C."""
    done = _run(TERMINATED_IN_A_DESTRUCTOR)
    assert (done.returncode, done.stdout, done.stderr) == (143, "", "")


def test_a_finished_command_is_not_interrupted() -> None:
    done = _run(AT_THE_END)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_an_error_without_an_interrupt_stays_one() -> None:
    done = _run(OF_ITS_OWN)
    assert done.returncode == 1
    assert "ValueError: a fault of the program" in done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_replay_that_is_ended_leaves_no_draft(tmp_path: Path, number: signal.Signals) -> None:
    """Expected: 128 and the signal's number, one line about it, neither a traceback nor a draft of the recording."""
    words = ["replay", str(ROOT / "recordings" / "landing-1"), "--out", str(tmp_path / "out")]
    process = subprocess.Popen(
        [sys.executable, "-m", "groundstation", *words], cwd=ROOT, stderr=subprocess.PIPE, text=True
    )
    while process.poll() is None and not list(tmp_path.rglob("*.part.session.rrd")):
        time.sleep(0.01)
    process.send_signal(number)
    err = process.communicate()[1]
    assert process.returncode == 128 + number
    assert err.splitlines()[-1].startswith("groundstation: interrupted; ")
    assert "Traceback" not in err
    assert not [path.name for path in tmp_path.rglob("*") if "session.rrd" in path.name]
    assert not (tmp_path / "out").exists() or list((tmp_path / "out").iterdir()), "no empty folder is left"
