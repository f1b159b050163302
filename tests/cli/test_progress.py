"""Progress of a run: bars on a terminal, lines without control codes in logs and pipes."""

import io
import subprocess
import sys
import threading
import time

import pytest

from groundstation.cli.progress import ProgressDisplay, ProgressLine, ProgressLog, StatusLine
from groundstation.cli.terminal import print_line, print_table
from tests.cli.screen import Terminal


@pytest.fixture(autouse=True)
def _terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.delenv("NO_COLOR", raising=False)


def test_terminal_shows_preparation_then_a_bar_within_its_width() -> None:
    screen = Terminal()
    with ProgressLine(screen, "replay") as line:
        assert screen.rows()[0].split() == ["replay", "preparing", "…"]
        for done in range(1, 13):
            line.update(done, 12)
    (row,) = screen.rows()
    assert row.startswith("replay ━")
    assert " 12/12 " in row
    assert len(row) <= 60
    assert screen.getvalue().endswith("\n\x1b[?25h"), "the cursor is visible on a line of its own"
    assert screen.colours


def test_terminal_shows_a_count_without_a_bar_if_the_total_is_unknown() -> None:
    screen = Terminal()
    with ProgressLine(screen, "import", "frame") as line:
        line.update(50, None)
    (row,) = screen.rows()
    assert "━" not in row
    assert row.split()[:2] == ["import", "50"]


def test_terminal_shows_a_bar_for_each_run_with_its_literal_name() -> None:
    screen = Terminal()
    with ProgressDisplay(screen) as progress:
        progress.update("[red]one", 1, 2)
        progress.update("[red]one", 2, 2)
        progress.update("two", 1, 4)
    first, second = screen.rows()
    assert first.startswith("[red]one")
    assert "2/2" in first
    assert second.startswith("two")
    assert "1/4" in second


def test_no_color_leaves_bars_without_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    screen = Terminal()
    with ProgressLine(screen, "replay") as line:
        line.update(1, 2)
    assert screen.colours == []


@pytest.mark.parametrize("total", [300, None])
def test_log_has_a_line_every_ten_seconds_and_one_at_the_end(total: int | None) -> None:
    file, now_s = io.StringIO(), 0.0
    log = ProgressLog(file, "pair", lambda: now_s)
    for done in range(26):
        now_s = float(done)
        log.update("replay", done, total)
    log.close()
    of = "" if total is None else " of 300"
    assert file.getvalue().splitlines() == [f"replay: {n}{of} pairs in {n}.0 s" for n in (10, 20, 25)]


def test_log_states_that_a_run_is_being_prepared_if_that_lasts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: one line after the interval, which is 0 here; none where the first step came before."""
    monkeypatch.setattr("groundstation.cli.progress._LOG_INTERVAL_S", 0.0)
    slow = io.StringIO()
    log = ProgressLog(slow, "pair")
    log.prepare("replay")
    for _ in range(1000):
        if slow.getvalue():
            break
        time.sleep(0.01)
    log.close()
    assert slow.getvalue() == "replay: preparing; the first run after an installation compiles\n"
    monkeypatch.setattr("groundstation.cli.progress._LOG_INTERVAL_S", 1000.0)
    log = ProgressLog(io.StringIO(), "pair")
    log.prepare("replay")
    log.close()
    for thread in threading.enumerate():
        if isinstance(thread, threading.Timer):
            thread.join(10.0)
            assert not thread.is_alive()


def test_pipe_gets_no_control_codes_even_if_colours_are_forced() -> None:
    code = (
        "import sys\n"
        "from groundstation.cli.progress import ProgressLine, StatusLine\n"
        "from groundstation.cli.terminal import print_table\n"
        "with ProgressLine(sys.stderr, 'replay') as line, StatusLine(sys.stderr) as status:\n"
        "    line.update(1, 1)\n"
        "    status.show('roi')\n"
        "print_table([('a', 'long ' * 60), ('bb', 'c')], sys.stderr)\n"
        "assert not sys.modules.keys() & {'rich.live', 'rich.progress'}\n"
    )
    environment = {"FORCE_COLOR": "1", "TERM": "xterm", "PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    table = ["a   " + ("long " * 60).strip(), "bb  c"]
    assert done.stderr.splitlines() == ["replay: 1 of 1 pairs in 0.0 s", *table]
    assert not done.stdout


def test_help_does_not_import_rich() -> None:
    code = "import sys; from groundstation.cli.main import build_parser; build_parser(); print('rich' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_table_is_wrapped_to_the_width_of_a_terminal() -> None:
    screen = Terminal()
    print_table([("gige:1", "word " * 20), ("opencv:0", "x")], screen)
    rows = screen.rows()
    assert max(map(len, rows)) <= 60
    assert [row.split()[0] for row in rows] == ["gige:1", "word", "opencv:0"]


def test_status_line_is_cut_to_the_width_and_removed_at_the_end() -> None:
    screen = Terminal()
    with StatusLine(screen) as line:
        line.show("roi: " + "x" * 100)
        (row,) = screen.rows()
        assert len(row) <= 60
        assert row.endswith("…")
        line.show("ekf")
        assert screen.rows() == ["ekf"]
    assert screen.rows() == []


class Closed(Terminal):
    """A terminal whose window was closed."""

    def write(self, _: str) -> int:
        raise OSError(5, "Input/output error")


def test_closed_terminal_does_not_stop_the_program() -> None:
    screen = Closed()
    print_line("text", screen)
    with ProgressLine(screen, "replay") as line, StatusLine(screen) as status:
        line.update(1, 2)
        status.show("roi")
