"""Requests to stop: Ctrl-C (SIGINT), SIGTERM, or a closed terminal (SIGHUP)."""

import signal
import threading
from types import TracebackType
from typing import Any


class StopRequest:
    """A context in which signals set a flag instead of ending the process; calling it returns the flag.

    After the first SIGINT or SIGTERM the previous handlers are restored, so that a second one ends the process at once.
    A closing terminal sends SIGHUP more than once, so SIGHUP only sets the flag; where it is ignored (`nohup`), it
    stays ignored.
    """

    def __init__(self) -> None:
        self._requested = threading.Event()
        self._before: dict[signal.Signals, Any] = {}

    def __call__(self) -> bool:
        """Return whether a stop has been requested."""
        return self._requested.is_set()

    def __enter__(self) -> "StopRequest":
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._on_interrupt)
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            self._before[signal.SIGHUP] = signal.signal(signal.SIGHUP, self._on_hang_up)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _on_interrupt(self, *_: object) -> None:
        self._requested.set()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._before[number])

    def _on_hang_up(self, *_: object) -> None:
        self._requested.set()
