"""SIGTERM in a process whose parent process may be ending as well.

`timeout`, systemd and containers send SIGTERM to a whole process group. The parent process then still moves its units
to where they are left, so that a process which drives or guards them has to continue until it is asked to stop. A
process is not told who else got the signal: it waits for the parent's announcement, and leaves where none comes.
"""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

# the parent's announcement: it is ending
ENDING = "ending"
# Longer than a parent that is computing, on a busy machine, takes to note its own signal and to announce it: a step of
# its pipeline may take a second there. Units are driven and guarded meanwhile as before.
GRACE_S = 2.0
_EXIT_CODE = 128 + signal.SIGTERM


class DeferredTermination:
    """SIGTERM of this process: it ends it at once, or within `deferred` only if the parent process is not ending.

    Parameters
    ----------
    clock : monotonic, s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._signalled_s: float | None = None
        self._parent_ends = self._deferring = False

    def install(self) -> None:
        """Handle SIGTERM from now on, one that came while it was blocked too; to be called in the main thread."""
        signal.signal(signal.SIGTERM, self._on_signal)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})

    @contextmanager
    def deferred(self) -> Iterator[None]:
        """Only note SIGTERM in this context, whose owner looks at `is_due`; outside of it raise SystemExit."""
        self._deferring = True
        try:
            yield
        finally:
            self._deferring = False

    def note_parent_ends(self) -> None:
        """Note the parent's announcement: a SIGTERM is ignored from now on, and so is one that came before."""
        self._parent_ends = True

    def is_due(self) -> bool:
        """Return whether a SIGTERM came, and the parent has announced nothing in the time for it."""
        if self._signalled_s is None or self._parent_ends:
            return False
        return self._clock() - self._signalled_s > GRACE_S

    def leave(self) -> None:
        """Raise SystemExit with the code of a program that ends in order after SIGTERM."""
        raise SystemExit(_EXIT_CODE)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        if not self._deferring:
            self.leave()
        # a second signal does not prolong the wait
        if self._signalled_s is None:
            self._signalled_s = self._clock()
