"""Whether somebody wants a program to end: Ctrl-C, SIGTERM, or a terminal that is gone."""

import signal
import threading
from types import TracebackType
from typing import Any


class StopAsked:
    """While this context is open, signals only ask; call it to hear whether one has.

    Whoever presses twice does not want to wait: after the first SIGINT or SIGTERM the next one does what it did before.
    SIGHUP comes more than once from a terminal that closes, so it only ever asks; where it is ignored (`nohup`), it is.
    """

    def __init__(self) -> None:
        self._asked = threading.Event()
        self._before: dict[signal.Signals, Any] = {}

    def __call__(self) -> bool:
        """Return whether an end is wanted."""
        return self._asked.is_set()

    def __enter__(self) -> "StopAsked":
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._pressed)
        if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            self._before[signal.SIGHUP] = signal.signal(signal.SIGHUP, self._hung_up)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _pressed(self, *_: object) -> None:
        self._asked.set()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._before[number])

    def _hung_up(self, *_: object) -> None:
        self._asked.set()
