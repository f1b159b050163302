"""The progress of runs: bars on a terminal, lines at a low rate elsewhere."""

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self, TextIO

from groundstation.cli.terminal import is_interactive, print_line
from groundstation.compilation import Compiling, compilation_watched

if TYPE_CHECKING:
    from groundstation.cli.progress_bars import StatusBar

_LOG_INTERVAL_S = 10.0
# what is compiled in less needs no words
_SHORT_S = 1.0


class _Progress(Protocol):
    def prepare(self, name: str) -> None:
        """Show that a run is being prepared."""

    def compiling(self, what: Compiling) -> None:
        """Show what is compiled."""

    def update(self, name: str, done: int, total: int | None) -> None:
        """Show the progress of a run."""

    def close(self) -> None:
        """Finish the display."""


class ProgressDisplay:
    """Progress of one run or several, each under its name; a context manager."""

    def __init__(self, stream: TextIO, unit: str = "pair") -> None:
        self._progress: _Progress
        if is_interactive(stream):
            from groundstation.cli import progress_bars

            self._progress = progress_bars.ProgressBars(stream, unit)
        else:
            self._progress = ProgressLog(stream, unit)
        self._watching = ExitStack()

    def __enter__(self) -> Self:
        self._watching.enter_context(compilation_watched(self._progress.compiling))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._watching.close()
        self._progress.close()

    def prepare(self, name: str) -> None:
        """Show that a run is being prepared; what a first run compiles is shown, too."""
        self._progress.prepare(name)

    def update(self, name: str, done: int, total: int | None) -> None:
        """Show ``done`` of ``total`` for a run; None if the total is unknown."""
        self._progress.update(name, done, total)


class ProgressLine:
    """Progress of a single run; a context manager."""

    def __init__(self, stream: TextIO, label: str, unit: str = "pair") -> None:
        self._display = ProgressDisplay(stream, unit)
        self._label = label

    def __enter__(self) -> Self:
        self._display.__enter__()
        self._display.prepare(self._label)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._display.__exit__(kind, fault, trace)

    def update(self, done: int, total: int | None) -> None:
        """Show ``done`` of ``total``; None if the total is unknown."""
        self._display.update(self._label, done, total)


class ProgressLog:
    """Progress as lines of a log: one for each run every ten seconds, and one when all have ended."""

    def __init__(self, stream: TextIO, unit: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._unit = unit
        self._clock = clock
        # by name: start, time of the last line, number done, total
        self._runs: dict[str, tuple[float, float, int, int | None]] = {}
        self._preparing: threading.Timer | None = None
        self._lock = threading.Lock()
        self._compilation = CompilationLog(stream, clock)

    def prepare(self, name: str) -> None:
        """Print a line if nothing has been done after ten seconds."""
        with self._lock:
            self._start_timer(name, first=True)

    def compiling(self, what: Compiling) -> None:
        """Print a line on what is compiled, in place of the one that something is prepared."""
        with self._lock:
            self._compilation.compiling(what)

    def _start_timer(self, name: str, *, first: bool) -> None:
        if self._preparing is not None:
            self._preparing.cancel()
        self._preparing = threading.Timer(_LOG_INTERVAL_S, self._print_preparing, (name, first))
        self._preparing.daemon = True
        self._preparing.start()

    def _print_preparing(self, name: str, first: bool) -> None:
        with self._lock:
            if self._preparing is not threading.current_thread():
                return
            if not self._compilation.lasts() and first:
                print_line(f"{name}: preparing; the first run after an installation compiles", self._stream)
            self._start_timer(name, first=False)

    def _prepared(self) -> None:
        with self._lock:
            if self._preparing is not None:
                self._preparing.cancel()
                self._preparing = None
            self._compilation.close()

    def update(self, name: str, done: int, total: int | None) -> None:
        """Print a line if the last one is ten seconds old."""
        self._prepared()
        now_s = self._clock()
        start_s, shown_s, _, _ = self._runs.get(name, (now_s, now_s, 0, None))
        self._runs[name] = (start_s, shown_s, done, total)
        if now_s - shown_s >= _LOG_INTERVAL_S:
            self._runs[name] = (start_s, now_s, done, total)
            self._print(name)

    def close(self) -> None:
        """Print the final line of each run."""
        self._prepared()
        for name in self._runs:
            self._print(name)

    def _print(self, name: str) -> None:
        start_s, _, done, total = self._runs[name]
        elapsed_s = self._clock() - start_s
        amount = f"{done} {self._unit}s" if total is None else f"{done} of {total} {self._unit}s"
        print_line(f"{name}: {amount} in {elapsed_s:.1f} s", self._stream)


class CompilationLog:
    """What is compiled: a line at the beginning, one every ten seconds, and one at the end; none where it is short."""

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._began_s: float | None = None
        self._next_s = 0.0
        self._before = 0
        self._latest: Compiling | None = None
        self._shown = False

    def compiling(self, what: Compiling) -> None:
        """Print a line if the last one is ten seconds old, the first after one second."""
        now_s = self._clock()
        if self._began_s is None:
            self._began_s, self._next_s, self._before = now_s, now_s + _SHORT_S, what.number - 1
        self._latest = what
        self.lasts()

    def lasts(self) -> bool:
        """Return whether something is compiled; print a line on it if the last one is ten seconds old."""
        what, now_s = self._latest, self._clock()
        if what is None or self._began_s is None:
            return False
        if now_s >= self._next_s:
            self._next_s, self._shown = now_s + _LOG_INTERVAL_S, True
            text = f"kernel {what.number} of at most {what.at_most} in {now_s - self._began_s:.0f} s: {what.kernel}"
            print_line(f"compiling, once after an installation: {text}", self._stream)
        return True

    def close(self) -> None:
        """Print how many there were, if anything was printed before; what is compiled later begins from zero."""
        if self._shown and self._began_s is not None and self._latest is not None:
            number = self._latest.number - self._before
            print_line(f"compiled {number} kernels in {self._clock() - self._began_s:.0f} s", self._stream)
        self._began_s, self._latest, self._shown = None, None, False


class StatusLine:
    """One line of text on a terminal, replaced by the next; nothing elsewhere. A context manager."""

    def __init__(self, stream: TextIO) -> None:
        self._bar: StatusBar | None = None
        if is_interactive(stream):
            from groundstation.cli import progress_bars

            self._bar = progress_bars.StatusBar(stream)
        self._log = CompilationLog(stream)
        self._watching = ExitStack()

    def __enter__(self) -> Self:
        self._watching.enter_context(compilation_watched(self._compiling))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._watching.close()
        self._log.close()
        if self._bar is not None:
            self._bar.close()

    def _compiling(self, what: Compiling) -> None:
        if self._bar is not None:
            self._bar.show(f"compiling, once: kernel {what.number} of at most {what.at_most}, {what.kernel}")
        else:
            self._log.compiling(what)

    def show(self, text: str) -> None:
        """Replace the line."""
        self._log.close()
        if self._bar is not None:
            self._bar.show(text)
