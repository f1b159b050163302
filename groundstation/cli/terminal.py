"""Output to the terminal: lines that outlive a closed terminal, tables, and consoles of `rich`.

`rich` is imported at first use only: it takes 40 ms, which `--help` need not wait for.
"""

import contextlib
import os
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, TextIO, cast

if TYPE_CHECKING:
    from rich.console import Console

# wider than any line: a pipe or a file has no width to wrap at
_UNLIMITED_COLUMNS = 100_000


def is_interactive(stream: TextIO) -> bool:
    """Return whether a stream is a terminal that can move its cursor: no pipe, no file, no TERM=dumb."""
    return stream.isatty() and os.environ.get("TERM", "").lower() not in ("dumb", "unknown")


def print_line(text: str, stream: TextIO) -> None:
    """Print and flush a line; if this fails (closed terminal, full disk), it and all further lines are discarded."""
    safe = SafeStream(stream)
    safe.write(f"{text}\n")
    safe.flush()


def print_table(rows: Iterable[Sequence[str]], stream: TextIO | None = None) -> None:
    """Print rows of cells in columns, wrapped to the width of a terminal; one line a row elsewhere."""
    from rich.console import Console
    from rich.table import Table

    stream = sys.stdout if stream is None else stream
    table = Table.grid(padding=(0, 2, 0, 0))
    for row in rows:
        while len(table.columns) < len(row):
            table.add_column(overflow="fold")
        table.add_row(*row)
    width = None if is_interactive(stream) else _UNLIMITED_COLUMNS
    console = Console(file=stream, width=width, highlight=False, markup=False, emoji=False, color_system=None)
    with console.capture() as captured:
        console.print(table)
    for line in captured.get().splitlines():
        print(line.rstrip(), file=stream)


def open_console(stream: TextIO) -> "Console":
    """Return a console on an interactive terminal; it never fails, and its text is taken literally."""
    from rich.console import Console

    file = cast("TextIO", SafeStream(stream))
    return Console(file=file, force_terminal=True, highlight=False, markup=False, emoji=False)


class SafeStream:
    """A text stream that discards what it cannot write.

    After the first failure the stream is redirected to the null device, so that flushing its buffer at exit does not
    fail again.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write the text, or discard it."""
        try:
            return self._stream.write(text)
        except OSError:
            self._redirect()
            return len(text)

    def flush(self) -> None:
        """Flush, or discard what is in the buffer."""
        try:
            self._stream.flush()
        except OSError:
            self._redirect()

    def isatty(self) -> bool:
        """Return whether it is a terminal."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """Return the descriptor of the stream."""
        return self._stream.fileno()

    @property
    def encoding(self) -> str:
        """The encoding of the stream."""
        return self._stream.encoding or "utf-8"

    def _redirect(self) -> None:
        with contextlib.suppress(OSError):
            null = os.open(os.devnull, os.O_WRONLY)
            try:
                os.dup2(null, self._stream.fileno())
            finally:
                os.close(null)
