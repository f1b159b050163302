"""The operator's screen, opened where it is wanted, and closed within the time for ending."""

import os
from collections.abc import Callable
from contextlib import ExitStack

from groundstation.live.board import LiveStatus
from groundstation.live.ending import Ending
from groundstation.live.operation import StatusSink
from groundstation.live.station_file import StationFile
from groundstation.rig.rig import Rig
from groundstation.sinks.sink import Sink

# of the time for ending, for what is still to be drawn and for the viewer
_SCREEN_S = 0.5


class StatusTeller:
    """A function as a `StatusSink`."""

    def __init__(self, tell: Callable[[LiveStatus], None]) -> None:
        self._tell = tell

    def tell(self, status: LiveStatus) -> None:
        """Pass it on."""
        self._tell(status)


def open_screen(
    kind: str,
    rig: Rig,
    file: StationFile,
    opened: ExitStack,
    ending: Ending,
    sinks: list[Sink],
    operators: list[StatusSink],
    say: Callable[[str], None],
) -> Callable[[], str]:
    """Open the operator's screen, "desktop", "browser" or "none"; returns what it has to say of itself."""
    if kind == "none":
        return lambda: ""
    from groundstation.viewer.live import LiveView
    from groundstation.viewer.viewer import open_live_stream, open_web_stream, stop_viewer

    if kind == "desktop":
        stream = open_live_stream("groundstation", os.environ, "--web shows the same in a browser")
    else:
        stream, address, process = open_web_stream("groundstation", os.environ)
        opened.callback(lambda: stop_viewer(process, ending.left_s(_SCREEN_S)))
        say(f"operator's screen: {address}")
    view = LiveView(stream, rig, file.name)
    opened.callback(lambda: view.close(ending.left_s(_SCREEN_S)))
    sinks.append(view)
    operators.append(StatusTeller(lambda status: view.show_status(status.t_s, status.lines)))
    return view.status_text
