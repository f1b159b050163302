"""The status of a live run: redrawn in place on a terminal, lines without control codes elsewhere."""

import io
from dataclasses import replace

import pytest

from groundstation.cli.status_display import StatusDisplay
from groundstation.live.status_board import DeviceState, LiveStatus
from groundstation.messages import TrackStatus
from tests.cli.screen import Terminal

OLD = "NO STATUS for {} s: the last one is old, the aircraft may be anywhere"
LONG = "left camera 30 Hz, its clock 0.0001 s behind ours, drifts +1 ppm"


@pytest.fixture(autouse=True)
def _terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("LINES", "24")
    monkeypatch.delenv("NO_COLOR", raising=False)


def status(*lines: str, track: TrackStatus = TrackStatus.SEARCHING, t_s: float = 1.0) -> LiveStatus:
    return LiveStatus(t_s=t_s, track=track, latency_p50_ms=0.0, latency_p99_ms=0.0, devices=(), dropped={}, lines=lines)


def test_terminal_shows_every_line_within_its_width_and_the_next_status_in_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    screen = Terminal()
    with StatusDisplay(screen) as display:
        display.show(status("searching", LONG))
        first = screen.rows()
        assert " ".join(" ".join(first).replace("•", "").split()) == f"searching {LONG}"
        assert len(first) == 3
        assert max(map(len, first)) <= 40
        assert first[2].startswith("  "), "a continued line is indented"
        display.show(status("tracking"))
        assert screen.rows() == ["• tracking"]


def test_terminal_shows_messages_above_the_status() -> None:
    screen = Terminal()
    with StatusDisplay(screen) as display:
        display.message("opening [red] …")
        display.show(status("searching", "left camera 30 Hz"))
        display.message("parking …")
        display.show(status("lost"))
    assert screen.rows() == ["opening [red] …", "parking …", "• lost"]
    assert screen.getvalue().rindex("\x1b[?25h") > screen.getvalue().rindex("\x1b[?25l"), "the cursor is visible"


def test_terminal_colours_state_and_silent_device_unless_no_color_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    silent = DeviceState(name="left camera", rate_hz=30.0, age_s=5.0)
    shown = replace(status("tracking", silent.summary(), track=TrackStatus.TRACKING), devices=(silent,))
    coloured, plain = Terminal(), Terminal()
    with StatusDisplay(coloured) as display:
        display.show(shown)
    monkeypatch.setenv("NO_COLOR", "1")
    with StatusDisplay(plain) as display:
        display.show(shown)
    assert {"1;32", "31"} <= set(coloured.colours)
    assert set(plain.colours) <= {"1"}
    assert plain.rows() == coloured.rows()


def test_terminal_does_not_colour_a_track_that_is_not_known_as_tracked() -> None:
    screen = Terminal()
    with StatusDisplay(screen) as display:
        display.show(status("unknown: was tracking", track=TrackStatus.TRACKING))
    assert set(screen.colours) == {"1;31"}


def test_log_has_a_line_at_a_change_and_every_five_seconds() -> None:
    file = io.StringIO()
    display = StatusDisplay(file)
    track, coast, lost = TrackStatus.TRACKING, TrackStatus.COASTING, TrackStatus.LOST
    for t_s, what in ((1.0, track), (1.5, track), (1.75, coast), (2.0, track), (5.9, track), (6.0, track), (6.3, lost)):
        display.show(status(what.value, track=what, t_s=t_s))
    for t_s in (6.5, 7.0, 11.49, 11.5):
        display.show(status(lost.value, track=lost, t_s=t_s))
    printed = [(float(line.split(" s  ")[0]), line.split()[-1]) for line in file.getvalue().splitlines()]
    assert printed == [(1.0, "tracking"), (1.8, "coasting"), (5.9, "tracking"), (6.5, "lost"), (11.5, "lost")]


def test_missing_status_is_shown_below_the_last_one_on_a_terminal_and_repeated_in_a_log() -> None:
    screen, file = Terminal(), io.StringIO()
    for stream in (screen, file):
        display = StatusDisplay(stream)
        display.show(status("tracking at 442 ± 1.3 m"))
        for age_s in (2.1, 2.6, 7.0, 7.1):
            display.silent(age_s)
            if stream is screen:
                assert screen.rows() == ["• tracking at 442 ± 1.3 m", f"! {OLD.format(round(age_s))}"]
        display.show(status("lost", t_s=9.0, track=TrackStatus.LOST))
        if stream is screen:
            assert screen.rows() == ["• lost"]
        display.silent(2.1)
        display.close()
    lines = file.getvalue().splitlines()
    assert lines[1:] == [OLD.format(2), OLD.format(7), "    9.0 s  lost", OLD.format(2)]


@pytest.mark.parametrize("term", ["dumb", "unknown"])
def test_terminal_without_cursor_movement_gets_plain_lines(term: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", term)
    screen = Terminal()
    StatusDisplay(screen).show(status("searching", LONG))
    assert screen.getvalue() == f"    1.0 s  searching · {LONG}\n"


def test_rates_and_clocks_are_shown_on_demand() -> None:
    well = DeviceState(name="left camera", rate_hz=30.0, age_s=0.0, note="its clock is still being found")
    shown = replace(status("tracking", well.summary(), track=TrackStatus.TRACKING), devices=(well,))
    brief, whole = Terminal(), Terminal()
    for screen, details in ((brief, False), (whole, True)):
        with StatusDisplay(screen, details=details) as display:
            display.show(shown)
    assert brief.rows() == ["• tracking", "• in order: left camera"]
    assert whole.rows() == ["• tracking", "• left camera 30 Hz, its clock is still being found"]
