"""The operator's status on a terminal, by `rich`; imported only where there is a terminal."""

from typing import TextIO

from rich.live import Live
from rich.table import Table
from rich.text import Text

from groundstation.cli.terminal import open_console
from groundstation.live.status_board import LiveStatus
from groundstation.messages import TrackStatus

_TRACK_STYLES = {
    TrackStatus.SEARCHING: "bold",
    TrackStatus.ACQUIRING: "bold cyan",
    TrackStatus.TRACKING: "bold green",
    TrackStatus.COASTING: "bold yellow",
    TrackStatus.LOST: "bold red",
}
_WARNING_STYLE, _SILENT_STYLE = "bold reverse red", "red"


class StatusScreen:
    """Track, devices and warnings, one row each, redrawn in place by the caller's thread.

    ``details``: with a row for each device, not only for those in trouble.
    """

    def __init__(self, stream: TextIO, *, details: bool) -> None:
        self._details = details
        self._console = open_console(stream)
        self._live = Live(
            console=self._console, auto_refresh=False, redirect_stdout=False, vertical_overflow="ellipsis"
        )
        self._status: LiveStatus | None = None
        self._closed = False

    def show(self, status: LiveStatus) -> None:
        """Replace the status."""
        self._status = status
        self._draw("")

    def warn(self, text: str) -> None:
        """Show the last status with a warning below it."""
        self._draw(text)

    def message(self, text: str) -> None:
        """Print a line above the status."""
        self._console.print(Text(text))

    def close(self) -> None:
        """Leave the last status on the terminal."""
        self._closed = True
        self._live.stop()

    def _draw(self, warning: str) -> None:
        if self._closed:
            return
        if not self._live.is_started:
            self._live.start()
            # a process that is killed must not leave a terminal without a cursor
            self._console.show_cursor(True)
        self._live.update(status_table(self._status, warning, details=self._details), refresh=True)


def status_table(status: LiveStatus | None, warning: str = "", *, details: bool = True) -> Table:
    """Return a row for each line of a status, and for the warning; a long line continues indented."""
    table = Table.grid(padding=(0, 1, 0, 0))
    table.add_column(width=1)
    table.add_column(overflow="fold")
    for number, (line, silent) in enumerate([] if status is None else status.rows(details=details)):
        style = _SILENT_STYLE if silent else ""
        if number == 0 and status is not None:
            style = "bold red" if line.startswith("unknown") else _TRACK_STYLES[status.track]
        table.add_row(Text("•", style=style), Text(line, style=style))
    if warning:
        table.add_row(Text("!", style=_WARNING_STYLE), Text(warning, style=_WARNING_STYLE))
    return table
