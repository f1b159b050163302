"""Progress of numba's compilation: what is told, to whom, and how a terminal and a log show it."""

import io
import multiprocessing as mp
import os
import subprocess
import sys
import threading
import weakref
from pathlib import Path

import pytest

from groundstation.cli import progress
from groundstation.cli.main import build_parser
from groundstation.cli.progress import CompilationLog, ProgressLine
from groundstation.cli.progress_bars import ProgressBars
from groundstation.cli.status_display import StatusDisplay
from groundstation.compilation import Compiling, _uncompiled, compilation_sent, compilation_watched, report, reported
from tests.cli.screen import Terminal

_ONE = Compiling(kernel="detection.flatten._edges", number=3, at_most=140)
# a module of the program that nothing else imports, so that its kernels are compiled in the empty cache
_PROGRAM = """
import numpy as np
from groundstation.compilation import compilation_watched, listen
listen()
from groundstation.geometry.mahalanobis import mahalanobis_squared
told = []
with compilation_watched(told.append):
    mahalanobis_squared(np.ones(2), np.eye(2))
    mahalanobis_squared(np.ones(2), np.eye(2))
print(*[(one.kernel, one.number, one.at_most) for one in told])
"""


@pytest.fixture(autouse=True)
def _terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "100")


def test_a_kernel_is_told_where_it_is_not_in_the_cache(tmp_path: Path) -> None:
    """Expected: once with its number in a first process, and nothing in a second one."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    told = [
        subprocess.run(
            [sys.executable, "-c", _PROGRAM], env=environment, check=True, capture_output=True, text=True
        ).stdout.strip()
        for _ in range(2)
    ]
    assert told == ["('geometry.mahalanobis.mahalanobis_squared', 1, 1)", ""]


def test_the_display_that_began_last_is_told() -> None:
    outer: list[Compiling] = []
    inner: list[Compiling] = []
    report(_ONE)
    with compilation_watched(outer.append):
        with compilation_watched(inner.append):
            report(_ONE)
        assert (outer, inner) == ([], [_ONE])
        report(_ONE)
    assert (outer, inner) == ([_ONE], [_ONE])


def test_another_process_is_told_of_too() -> None:
    """Expected: through a pipe; an answer that is none of it is passed on, and a reader that has ended is no error."""
    here, there = mp.Pipe()
    told: list[Compiling] = []
    with compilation_sent(there.send):
        report(_ONE)
    there.send(0.25)
    with compilation_watched(told.append):
        assert [reported(here.recv()), reported(here.recv())] == [None, 0.25]
    assert told == [_ONE]
    here.close()
    with compilation_sent(there.send):
        report(_ONE)


def test_a_log_has_lines_at_a_low_rate_and_none_where_it_is_short() -> None:
    now_s = 0.0
    stream = io.StringIO()
    log = CompilationLog(stream, lambda: now_s)
    for number in range(1, 26):
        now_s = float(number)
        log.compiling(Compiling(kernel="a.b", number=number, at_most=30))
    now_s = 26.0
    log.close()
    log.compiling(_ONE)
    log.close()
    assert stream.getvalue().splitlines() == [
        "compiling, once after an installation: kernel 2 of at most 30 in 1 s: a.b",
        "compiling, once after an installation: kernel 12 of at most 30 in 11 s: a.b",
        "compiling, once after an installation: kernel 22 of at most 30 in 21 s: a.b",
        "compiled 25 kernels in 25 s",
    ]


def test_kernels_are_counted_from_where_a_phase_began() -> None:
    now_s = 0.0
    stream = io.StringIO()
    log = CompilationLog(stream, lambda: now_s)
    assert not log.lasts()
    log.compiling(_ONE)
    now_s = 12.0
    assert log.lasts()
    log.close()
    assert not log.lasts()
    assert stream.getvalue().splitlines() == [
        "compiling, once after an installation: kernel 3 of at most 140 in 12 s: detection.flatten._edges",
        "compiled 1 kernels in 12 s",
    ]


def test_a_slow_kernel_has_lines_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the first event leaves the timer running, which prints."""
    monkeypatch.setattr(progress, "_LOG_INTERVAL_S", 0.02)
    monkeypatch.setattr(progress, "_SHORT_S", 0.01)
    printed = threading.Event()
    monkeypatch.setattr(progress, "print_line", lambda text, _: printed.set() if "compiling, once" in text else None)
    log = progress.ProgressLog(io.StringIO(), "pair")
    log.prepare("replay")
    log.compiling(_ONE)
    assert printed.wait(10.0)
    log.close()


def test_a_dead_proxy_in_memory_is_no_fault() -> None:
    class Thing:
        pass

    thing = Thing()
    proxies = [weakref.proxy(thing)]
    del thing
    assert isinstance(_uncompiled(), set)
    assert len(proxies) == 1


def test_a_terminal_has_a_bar_while_it_lasts() -> None:
    screen = Terminal()
    with ProgressLine(screen, "replay") as line:
        report(_ONE)
        shown = screen.rows()
        assert [row.split()[0] for row in shown] == ["replay", "compiling,"]
        assert "2/140" in shown[1]
        assert "_edges" in shown[1]
        assert shown[1].rstrip().endswith("0 s")
        line.update(1, 2)
        assert [row.split()[0] for row in screen.rows() if row.strip()] == ["replay"]


def test_a_live_run_shows_it_before_its_first_message() -> None:
    screen = Terminal()
    with StatusDisplay(screen) as display:
        display.message("building the simulated range …")
        report(_ONE)
        assert "2/140" in screen.rows()[-1]
        display.message("opening the PTUs …")
    assert [row.strip() for row in screen.rows() if row.strip()] == [
        "building the simulated range …",
        "opening the PTUs …",
    ]


def test_bars_end_without_a_run() -> None:
    """Expected: a compilation alone is a whole display, and its thread ends with it."""
    screen = Terminal()
    bars = ProgressBars(screen, "kernel")
    bars.compiling(_ONE)
    bars.close()
    bars.close()
    assert screen.getvalue().endswith("\x1b[?25h")


def test_commands_without_kernels_are_commands() -> None:
    from groundstation.cli.main import _WITHOUT_KERNELS

    for command in _WITHOUT_KERNELS:
        with pytest.raises(SystemExit) as end:
            build_parser().parse_args([command, "--help"])
        assert end.value.code == 0
