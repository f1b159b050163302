"""The progress of runs: bars on a terminal, lines at a low rate elsewhere."""

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self, TextIO

from groundstation.cli.terminal import is_interactive, print_line

if TYPE_CHECKING:
    from groundstation.cli.progress_bars import StatusBar

_LOG_INTERVAL_S = 10.0


class _Progress(Protocol):
    def prepare(self, name: str) -> None:
        """Show that a run is being prepared."""

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

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.close()

    def prepare(self, name: str) -> None:
        """Show that a run is being prepared; a first run compiles for some seconds."""
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

    def prepare(self, name: str) -> None:
        """Print a line if nothing has been done after ten seconds: the first run after an installation compiles."""
        self._preparing = threading.Timer(_LOG_INTERVAL_S, self._print_preparing, (name,))
        self._preparing.daemon = True
        self._preparing.start()

    def _print_preparing(self, name: str) -> None:
        print_line(f"{name}: preparing; the first run after an installation compiles, a minute of a core", self._stream)

    def _prepared(self) -> None:
        if self._preparing is not None:
            self._preparing.cancel()
            self._preparing = None

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


class StatusLine:
    """One line of text on a terminal, replaced by the next; nothing elsewhere. A context manager."""

    def __init__(self, stream: TextIO) -> None:
        self._bar: StatusBar | None = None
        if is_interactive(stream):
            from groundstation.cli import progress_bars

            self._bar = progress_bars.StatusBar(stream)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()

    def show(self, text: str) -> None:
        """Replace the line."""
        if self._bar is not None:
            self._bar.show(text)
