"""The operator's screen, opened where it is wanted, and closed within the time for shutdown."""

import os
from collections.abc import Callable
from contextlib import ExitStack

from groundstation.live.operation import StatusSink
from groundstation.live.shutdown import Shutdown
from groundstation.live.station_file import StationFile
from groundstation.live.status_board import LiveStatus
from groundstation.rig.rig import Rig
from groundstation.sinks.sink import Sink

# of the time for shutdown, for what is still to be drawn and for the viewer
_SCREEN_S = 0.5


class StatusCallback:
    """A function as a `StatusSink`."""

    def __init__(self, callback: Callable[[LiveStatus], None]) -> None:
        self._callback = callback

    def update(self, status: LiveStatus) -> None:
        """Pass it on."""
        self._callback(status)


def open_screen(
    kind: str,
    rig: Rig,
    file: StationFile,
    opened: ExitStack,
    shutdown: Shutdown,
    sinks: list[Sink],
    operators: list[StatusSink],
    say: Callable[[str], None],
    web_port: int | None = None,
) -> Callable[[], str]:
    """Open the operator's screen, "desktop", "browser" or "none"; returns what it has to say of itself.

    ``web_port`` is the port of the browser's page, None for any that is free.
    """
    if kind == "none":
        return lambda: ""
    from groundstation.viewer.live_view import LiveView
    from groundstation.viewer.viewer_process import open_live_stream, open_web_stream, stop_viewer

    if kind == "desktop":
        stream = open_live_stream("groundstation", os.environ, "--web shows the same in a browser")
    else:
        stream, address, process = open_web_stream("groundstation", os.environ, web_port)
        opened.callback(lambda: stop_viewer(process, shutdown.left_s(_SCREEN_S)))
        say(f"operator's screen: {address}")
    view = LiveView(stream, rig, file.name)
    opened.callback(lambda: view.close(shutdown.left_s(_SCREEN_S)))
    sinks.append(view)
    operators.append(StatusCallback(lambda status: view.show_status(status.t_s, status.lines)))
    return view.status_text
