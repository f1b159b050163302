"""What leaves a simulated camera later than it was made, each at its own time and in order, as over a busy bus."""

import threading
from collections import deque
from collections.abc import Callable
from multiprocessing.connection import Connection


class DelayLine:
    """Sends items into a pipe when they are due, from a thread of its own, so that exposures are not delayed.

    Parameters
    ----------
    clock : monotonic, s.
    """

    def __init__(self, pipe: Connection, clock: Callable[[], float]) -> None:
        self.broken = False
        """Whether the reading end is closed."""
        self._pipe, self._clock = pipe, clock
        self._waiting: deque[tuple[float, object]] = deque()
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def send(self, due_s: float, what: object) -> None:
        """Put something in line; nothing overtakes what was put there before."""
        with self._changed:
            self._waiting.append((due_s, what))
            self._changed.notify()

    def close(self) -> None:
        """Forget what waits."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(1.0)

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed)
                if self._closed:
                    return
                due_s, what = self._waiting[0]
                left_s = due_s - self._clock()
                if left_s > 0.0:
                    self._changed.wait(left_s)
                    continue
                self._waiting.popleft()
            try:
                self._pipe.send(what)
            except OSError:
                self.broken = True
                return
