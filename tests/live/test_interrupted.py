"""Ctrl-C or a closed terminal: no process is left, and no traceback is printed."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import Any, TextIO
from unittest.mock import MagicMock

import pytest

from groundstation.cli.main import main
from groundstation.cli.stop_request import StopRequest
from groundstation.live.abandonable import abandonable
from groundstation.live.child_process import terminal_signals_blocked
from groundstation.live.command import LiveRequest, LiveResult, live
from groundstation.live.station_simulator import StationSimulator
from groundstation.live.status_board import LiveStatus
from groundstation.simulation.attached_simulator import AttachedSimulator
from groundstation.simulation.simulated_station import SimulatedStation, SimulatedStationConfig
from groundstation.simulation.simulated_station_file import simulated_station_file
from tests.cli.test_status_display import status
from tests.live.test_ending_words import ended

SIGNALS = (signal.SIGINT, signal.SIGHUP)
ASKED = "import signal, sys; sys.exit(sum(s in signal.pthread_sigmask(signal.SIG_BLOCK, []) for s in (1, 2)))"
STARTED = """
import signal
from multiprocessing import resource_tracker
from pathlib import Path
from groundstation.live.child_process import terminal_signals_blocked
with terminal_signals_blocked():
    inside = signal.pthread_sigmask(signal.SIG_BLOCK, [])
lines = Path(f"/proc/{resource_tracker._resource_tracker._pid}/status").read_text().splitlines()
blocked = int(next(line for line in lines if line.startswith("SigBlk")).split()[1], 16)
print(sorted(int(s) for s in inside), blocked & 1, sorted(signal.pthread_sigmask(signal.SIG_BLOCK, [])))
"""

FORCED = """
import os
from multiprocessing.shared_memory import SharedMemory
from groundstation.live.child_process import terminal_signals_blocked
with terminal_signals_blocked():
    block = SharedMemory(create=True, size=16)
print(block.name, flush=True)
os._exit(7)
"""
# the command, with a step of its preparation that does not end
HANGING = """
import signal, sys, time
import groundstation.live.command as command
from groundstation.cli.start import main
def hang(*_):
    print("hangs", flush=True)
    time.sleep(600)
command.write_provenance = hang
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(main())
"""


def test_a_child_ignores_signals_and_its_parent_handles_them_again() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with terminal_signals_blocked():
        deaf = subprocess.run([sys.executable, "-S", "-c", ASKED], check=False).returncode
    hears = subprocess.run([sys.executable, "-S", "-c", ASKED], check=False).returncode
    assert (deaf, hears) == (2, sum(s in before for s in SIGNALS))
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the mask of another process is read in /proc")
def test_the_first_child_is_as_deaf_and_so_is_the_librarys_own_process() -> None:
    """Expected: where `multiprocessing` starts its tracker only now, after which its caller handles Ctrl-C again."""
    done = subprocess.run([sys.executable, "-c", STARTED], check=True, capture_output=True, text=True)
    # SIGHUP, SIGINT, SIGQUIT and SIGTSTP: all that a terminal's keys send
    assert done.stdout == "[1, 2, 3, 20] 1 []\n"


def test_memory_is_given_back_quietly_after_a_forced_end() -> None:
    """Expected: the library's own process removes the block of a program that did not, and prints nothing of it."""
    done = subprocess.run([sys.executable, "-c", FORCED], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (7, "")
    with pytest.raises(FileNotFoundError):
        SharedMemory(name=done.stdout.strip())


def test_abandoned_devices_are_not_opened(tmp_path: Path) -> None:
    reported: list[str] = []
    request = LiveRequest(station=None, out=tmp_path / "out")
    simulator = SimulatedStation(SimulatedStationConfig())
    with pytest.raises(KeyboardInterrupt):
        live(request, lambda: True, lambda status: None, reported.append, simulator)
    assert reported == []


def test_a_hanging_step_before_operation_is_abandoned_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Expected: while something compiles or opens that does not return, the bound of the end holds as in operation."""
    asked, given_up, reported = threading.Event(), threading.Event(), list[str]()
    killed, left = threading.Event(), list[tuple[bool, bool, bool]]()

    def hangs(*_: object) -> None:
        asked.set()
        assert given_up.wait(60.0)

    def force_exit(line: str, begun: bool) -> None:
        reported.append(line)
        left.append((begun, killed.is_set(), (tmp_path / "out").exists()))
        given_up.set()

    monkeypatch.setattr("groundstation.live.command.write_provenance", hangs)
    monkeypatch.setattr("groundstation.live.command.HeadManager", lambda *_: MagicMock())
    request = LiveRequest(station=None, out=tmp_path / "out", record=False)
    simulator = AttachedSimulator(MagicMock(truth={}), simulated_station_file(tmp_path / "range", 30.0, None), 0.0)
    monkeypatch.setattr(simulator, "kill", killed.set)
    with pytest.raises(KeyboardInterrupt):
        live(request, asked.is_set, lambda status: None, lambda line: None, simulator, force_exit)
    # the operation had not begun; what could still write had ended, and the folder was gone
    assert left == [(False, True, False)]
    # nothing is recorded yet, and nothing reported of it
    assert reported == ["did not end within 3 s and is ended by force; the heads' processes halt them now"]


def test_a_forced_end_before_operation_is_an_interrupt(tmp_path: Path) -> None:
    """Expected: exit code 130 and one line about it; neither a folder nor a word of a library is left."""
    out = tmp_path / "out"
    words = ["live", "--simulate", "--for", "3", "--rate", "5", "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-c", HANGING, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "hangs\n"
    os.killpg(process.pid, signal.SIGINT)
    err = process.communicate()[1]
    assert process.returncode == 130
    assert [line for line in err.splitlines() if not line.endswith("…")] == [
        "groundstation: interrupted; did not end within 3 s and is ended by force; the heads' processes halt them now; "
        f"nothing was written to {out}"
    ]
    assert not out.exists()


def test_a_stop_is_heard_while_the_search_is_measured(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Expected: the measurement, which takes seconds on a busy machine, is not waited for."""
    asked, ended = threading.Event(), threading.Event()

    class Measuring:
        def __init__(self, _: object, search_s: Callable[[], float], stop: Callable[[], bool]) -> None:
            self.search_s = search_s

        def __enter__(self) -> None:
            self.search_s()

        def __exit__(self, *_: object) -> None: ...

    def measured(*_: object) -> float:
        asked.set()
        assert ended.wait(60.0)
        return 0.0

    monkeypatch.setattr("groundstation.simulation.simulated_station.DeviceSimulator", Measuring)
    monkeypatch.setattr("groundstation.simulation.simulated_station.search_pair_s", measured)
    station = SimulatedStation(SimulatedStationConfig(rate_hz=None), asked.is_set)
    file = station.station_file(None, tmp_path / "range")
    with pytest.raises(KeyboardInterrupt), ExitStack() as opened:
        station.open(file, tmp_path, opened, lambda line: None)
    assert not ended.is_set()
    ended.set()


def test_a_step_that_ends_gives_what_it_found_or_its_fault() -> None:
    assert abandonable(lambda: 3, lambda: False) == 3
    with pytest.raises(ZeroDivisionError):
        abandonable(lambda: 1 // 0, lambda: False)


@pytest.fixture
def heard() -> Iterator[None]:
    """SIGHUP as a terminal's programs have it, also where these tests run by nohup, which ignores it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.fixture
def dead_terminal() -> Iterator[TextIO]:
    """A terminal whose window has been closed: every write is an error."""
    window, end = os.openpty()
    os.close(window)
    with os.fdopen(end, "w", encoding="utf-8", closefd=True) as stream:
        with pytest.raises(OSError, match="Input/output error"):
            os.write(end, b"x")
        yield stream


def hang_up(times: int) -> None:
    for _ in range(times):
        os.kill(os.getpid(), signal.SIGHUP)


@pytest.mark.usefixtures("heard")
def test_a_closed_terminal_lands_it_softly(dead_terminal: TextIO, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: SIGHUP, however often, only requests the end, and a failed message stops nothing; exit code 0."""

    def flown(
        request: LiveRequest,
        stop: Callable[[], bool],
        tell: Callable[[LiveStatus], None],
        say: Callable[[str], None],
        simulator: StationSimulator | None,
        force_exit: Callable[[str, bool], None],
    ) -> LiveResult:
        say("opening the PTUs")
        assert not stop()
        hang_up(3)
        assert stop()
        tell(status("tracking"))
        tell(status("parking"))
        return ended()

    monkeypatch.setattr("groundstation.live.command.live", flown)
    monkeypatch.setattr(sys, "stdout", dead_terminal)
    monkeypatch.setattr(sys, "stderr", dead_terminal)
    before = signal.getsignal(signal.SIGHUP)
    assert main(["live", "--simulate", "--out", "x"]) == 0
    assert signal.getsignal(signal.SIGHUP) is before
    # nothing is left that would fail when the program ends
    dead_terminal.flush()


@pytest.mark.usefixtures("heard")
def test_a_terminal_that_closes_while_it_starts(
    dead_terminal: TextIO, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Expected: as after Ctrl-C: nothing is opened, nothing left behind, exit code 130."""

    def starting(*given: Any, **named: Any) -> LiveResult:
        hang_up(2)
        return live(*given, **named)

    monkeypatch.setattr("groundstation.live.command.live", starting)
    monkeypatch.setattr(sys, "stderr", dead_terminal)
    # one that did not receive it would fly without end
    assert main(["live", "--simulate", "--for", "1", "--out", str(tmp_path / "out")]) == 130
    assert not (tmp_path / "out").exists()


def test_nohup_is_respected_and_a_second_ctrl_c_ends_the_wait() -> None:
    before = {s: signal.getsignal(s) for s in (signal.SIGHUP, signal.SIGINT)}
    try:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with StopRequest() as stop:
            hang_up(1)
            assert not stop()
            os.kill(os.getpid(), signal.SIGINT)
            assert stop()
            assert signal.getsignal(signal.SIGINT) is before[signal.SIGINT]
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
