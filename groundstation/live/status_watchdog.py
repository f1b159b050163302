"""Watchdog of the operator's status: detects that the thread that updates it hangs."""

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

# four times what usually lies between two statuses (`groundstation.live.operation`)
SILENT_S = 2.0
_LOOK_EVERY_S = 0.5


class StatusWatchdog:
    """Calls ``silent`` with the newest status's age, s, over and over while none has come for `SILENT_S`.

    A context manager, with a thread of its own inside; `check` is what it does. Before the first status it is quiet.
    """

    def __init__(self, silent: Callable[[float], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._silent, self._clock = silent, clock
        self._newest_s: float | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name="status watch", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        # it may hang in what it calls as well as anything else
        self._thread.join(_LOOK_EVERY_S)

    def notify(self) -> None:
        """Record that a status was shown; thread-safe."""
        self._newest_s = self._clock()

    def check(self) -> None:
        """Look once."""
        newest_s = self._newest_s
        if newest_s is None:
            return
        age_s = self._clock() - newest_s
        if age_s > SILENT_S:
            self._silent(age_s)

    def _work(self) -> None:
        while not self._ended.wait(_LOOK_EVERY_S):
            self.check()
