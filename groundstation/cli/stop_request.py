"""Requests to stop: Ctrl-C (SIGINT), SIGTERM, or a closed terminal (SIGHUP)."""

import signal
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

# `timeout` sends SIGTERM to its process and then to the group; a process that computes handles the second one later
_SAME_S = 1.0


class StopRequest:
    """A context in which signals set a flag instead of ending the process; calling it returns the flag.

    After the first SIGINT or SIGTERM the previous handlers are restored, so that a second one ends the process at once;
    a SIGTERM that follows another one within a second is one request with it.
    A closing terminal sends SIGHUP more than once, so SIGHUP only sets the flag; where it is ignored (`nohup`), it
    stays ignored.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._terminated_s: float | None = None
        self._requested = threading.Event()
        self._before: dict[signal.Signals, Any] = {}

    def __call__(self) -> bool:
        """Return whether a stop has been requested."""
        return self._requested.is_set()

    def __enter__(self) -> "StopRequest":
        self._before[signal.SIGINT] = signal.signal(signal.SIGINT, self._on_interrupt)
        self._before[signal.SIGTERM] = signal.signal(signal.SIGTERM, self._on_termination)
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

    def _on_termination(self, *_: object) -> None:
        now_s = self._clock()
        if self._terminated_s is None:
            self._terminated_s = now_s
            self._requested.set()
            signal.signal(signal.SIGINT, self._before[signal.SIGINT])
        elif now_s - self._terminated_s > _SAME_S:
            signal.signal(signal.SIGTERM, self._before[signal.SIGTERM])
            signal.raise_signal(signal.SIGTERM)

    def _on_hang_up(self, *_: object) -> None:
        self._requested.set()
