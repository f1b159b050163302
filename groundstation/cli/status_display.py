"""The status of a live run on the operator's terminal."""

import math
import threading
from contextlib import ExitStack
from types import TracebackType
from typing import TYPE_CHECKING, Self, TextIO

from groundstation.cli.progress import CompilationLog
from groundstation.cli.terminal import is_interactive, print_line
from groundstation.compilation import Compiling, compilation_watched

if TYPE_CHECKING:
    from groundstation.cli.progress_bars import ProgressBars
    from groundstation.cli.status_screen import StatusScreen
    from groundstation.live.status_board import LiveStatus
    from groundstation.messages import TrackStatus

# without a terminal: interval of the lines, and the shorter one at a change of the track's status
_LINE_EVERY_S, _CHANGE_EVERY_S = 5.0, 0.5


class StatusDisplay:
    """The status on a terminal, updated in place; ``details``: with one line for each device, its rate and its clock.

    If the stream is no terminal: one line every five seconds, and at a change of the track's status, at most one in
    half a second. What is compiled before the first status is shown as its progress. A context manager; may be called
    from two threads.
    """

    def __init__(self, stream: TextIO, *, details: bool = True) -> None:
        self._stream, self._details = stream, details
        self._lock = threading.Lock()
        self._screen: StatusScreen | None = None
        if is_interactive(stream):
            from groundstation.cli import status_screen

            self._screen = status_screen.StatusScreen(stream, details=details)
        self._printed_s = -math.inf
        self._printed: TrackStatus | None = None
        self._silent_s = 0.0
        self._watching = ExitStack()
        self._compilation: CompilationLog | ProgressBars | None = None

    def __enter__(self) -> Self:
        self._watching.enter_context(compilation_watched(self._compiling))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._watching.close()
        self.close()

    def _compiling(self, what: Compiling) -> None:
        with self._lock:
            if not math.isinf(self._printed_s):
                return
            if self._compilation is None:
                self._compilation = self._opened()
            self._compilation.compiling(what)

    def _opened(self) -> "CompilationLog | ProgressBars":
        if self._screen is None:
            return CompilationLog(self._stream)
        from groundstation.cli import progress_bars

        return progress_bars.ProgressBars(self._stream, "kernel")

    def _end_compilation(self) -> None:
        if self._compilation is not None:
            self._compilation.close()
            self._compilation = None

    def show(self, status: "LiveStatus") -> None:
        """Show a status."""
        with self._lock:
            self._end_compilation()
            self._silent_s = 0.0
            if self._screen is not None:
                self._printed_s = status.t_s
                self._screen.show(status)
                return
            since_s = status.t_s - self._printed_s
            if since_s >= _LINE_EVERY_S or (status.track is not self._printed and since_s >= _CHANGE_EVERY_S):
                self._printed_s, self._printed = status.t_s, status.track
                print_line(f"{status.t_s:7.1f} s  {status.one_line(details=self._details)}", self._stream)

    def silent(self, age_s: float) -> None:
        """Show a warning that no status has arrived for some seconds."""
        with self._lock:
            text = f"NO STATUS for {age_s:.0f} s: the last one is old, the aircraft may be anywhere"
            if self._screen is not None:
                self._screen.warn(text)
            elif age_s >= self._silent_s:
                self._silent_s = age_s + _LINE_EVERY_S
                print_line(text, self._stream)

    def message(self, text: str) -> None:
        """Print a line, on a terminal above the status."""
        with self._lock:
            self._end_compilation()
            if self._screen is not None:
                self._screen.message(text)
            else:
                print_line(text, self._stream)

    def close(self) -> None:
        """Leave the last status on the terminal; lines printed later stand below it."""
        with self._lock:
            self._end_compilation()
            if self._screen is not None:
                self._screen.close()
