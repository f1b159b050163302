"""Progress bars and a status line on a terminal, by `rich`; imported only where there is a terminal."""

import sys
import threading
import time
from typing import TextIO

from rich.live import Live
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.progress_bar import ProgressBar
from rich.text import Text

from groundstation.cli.terminal import open_console
from groundstation.compilation import Compiling

# between redraws: drawing costs about a millisecond, and runs report up to a thousand steps a second
_REDRAW_S = 0.1
# one kernel may take many seconds
_COMPILATION_REDRAW_S = 0.5
_COMPILATION = "compiling, once"


class KnownTotalBar(BarColumn):
    """The bar of a run whose total is known; nothing for another."""

    def render(self, task: Task) -> ProgressBar | Text:  # type: ignore[override] # a bar or nothing
        """Return the bar of one run."""
        return Text() if task.total is None else super().render(task)


class CountColumn(ProgressColumn):
    """Steps done, of the total if it is known; before the first step, that the run is being prepared."""

    def render(self, task: Task) -> Text:
        """Return the text of one run."""
        if not task.started:
            return Text("preparing …")
        done = f"{task.completed:.0f}"
        return Text(done if task.total is None else f"{done:>{len(f'{task.total:.0f}')}}/{task.total:.0f}")


class RateColumn(ProgressColumn):
    """Steps per second, once there are two of them."""

    def __init__(self, unit: str) -> None:
        super().__init__()
        self._unit = unit

    def render(self, task: Task) -> Text:
        """Return the text of one run."""
        if "kernel" in task.fields:
            return Text(task.fields["kernel"])
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.1f} {self._unit}s/s")


class TimeColumn(TimeRemainingColumn):
    """The time that a run has left; of a compilation, the time that it has taken."""

    def render(self, task: Task) -> Text:
        """Return the text of one run."""
        if "kernel" in task.fields:
            return Text(f"{task.elapsed or 0.0:.0f} s")
        return super().render(task)


class ProgressBars:
    """One bar for each run, drawn by the caller's own thread, and one for what is compiled, drawn also meanwhile."""

    def __init__(self, stream: TextIO, unit: str) -> None:
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            KnownTotalBar(bar_width=None),
            CountColumn(),
            RateColumn(unit),
            TimeColumn(compact=True),
            console=open_console(stream),
            auto_refresh=False,
            redirect_stdout=False,
            redirect_stderr=stream is sys.stderr,
            expand=True,
        )
        self._tasks: dict[str, TaskID] = {}
        self._drawn_s = 0.0
        self._compilation: TaskID | None = None
        self._compiled = threading.Event()
        self._begun = False

    def prepare(self, name: str) -> None:
        """Show the bar of a run that has not begun."""
        self._begin()
        self._tasks[name] = self._progress.add_task(name, start=False, total=None)
        self._progress.refresh()

    def compiling(self, what: Compiling) -> None:
        """Show what is compiled, in a row of its own."""
        self._begin()
        if self._compilation is None:
            self._compilation = self._progress.add_task(_COMPILATION, total=what.at_most, kernel="")
            self._compiled.clear()
            threading.Thread(target=self._redraw, args=(self._compiled,), daemon=True).start()
        self._progress.update(
            self._compilation, completed=what.number - 1, total=what.at_most, kernel=what.kernel.rpartition(".")[2]
        )
        self._progress.refresh()

    def _redraw(self, compiled: threading.Event) -> None:
        while not compiled.wait(_COMPILATION_REDRAW_S):
            self._progress.refresh()

    def _end_compilation(self) -> None:
        """Remove its row: what follows may compile again."""
        if self._compilation is not None:
            self._compiled.set()
            self._progress.remove_task(self._compilation)
            self._compilation = None

    def update(self, name: str, done: int, total: int | None) -> None:
        """Show the progress of a run."""
        if name not in self._tasks:
            self.prepare(name)
        self._end_compilation()
        task = self._tasks[name]
        self._progress.start_task(task)
        self._progress.update(task, completed=done, total=total)
        now_s = time.monotonic()
        if now_s - self._drawn_s >= _REDRAW_S:
            self._drawn_s = now_s
            self._progress.refresh()

    def close(self) -> None:
        """Draw the bars a last time and leave them on the screen."""
        if self._begun:
            self._end_compilation()
            self._progress.stop()
            self._begun = False

    def _begin(self) -> None:
        if not self._begun:
            self._begun = True
            self._progress.start()
            # a process that is killed must not leave a terminal without a cursor
            self._progress.console.show_cursor(True)


class StatusBar:
    """One line of text, cut to the width of the terminal and removed at the end."""

    def __init__(self, stream: TextIO) -> None:
        console = open_console(stream)
        self._live = Live(console=console, auto_refresh=False, transient=True, redirect_stdout=False)
        self._live.start()
        console.show_cursor(True)

    def show(self, text: str) -> None:
        """Replace the line."""
        self._live.update(Text(text, no_wrap=True, overflow="ellipsis"), refresh=True)

    def close(self) -> None:
        """Remove the line."""
        self._live.stop()
