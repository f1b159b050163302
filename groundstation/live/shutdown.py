"""Time budget of a station's shutdown, and forced exit once it is exceeded.

Parking is part of it. Each step takes its share of what is left; a step that hangs all the same is ended with the whole
program: the PTUs' process and the motion guard see that, and halt every head. Only a recorder that still writes is
waited for, as long as bytes go to the disk.
"""

import math
import threading
import time
from collections.abc import Callable

# from Ctrl-C to the program's end, parking included, unless the station file gives parking a time of its own
END_S = 3.0
# of it, what heads may take to park: 30° at 20°/s
PARK_S = 1.5
# kept for closing the files
_FILES_S = 0.6
_LEAST_S = 0.1
_LOOK_S = 0.05
# a disk that took nothing for so long is not waited for
_STALLED_S = 1.0


class Shutdown:
    """Deadline of the shutdown, counted from the first stop request.

    Parameters
    ----------
    stop : whether a stop is requested.
    park_s : what the station file gives parking, on top of `END_S`; None takes `PARK_S` out of it.
    force_exit : ends the program at once, with the line that it gets; None lets it hang.
    clock : monotonic, s.
    """

    def __init__(
        self,
        stop: Callable[[], bool],
        park_s: float | None = None,
        *,
        force_exit: Callable[[str], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._stop, self._force_exit, self._clock = stop, force_exit, clock
        self.parking_s = PARK_S if park_s is None else park_s
        self.bound_s = END_S if park_s is None else END_S + park_s
        self._begun_s: float | None = None
        self._written: Callable[[], int] = lambda: 0
        self._newest = -1
        self._moved_s = -math.inf
        self._done = threading.Event()
        self._begun = threading.Event()

    def on_begin(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` when the shutdown begins, at once if it has, in a thread of its own: it may hang, too."""
        threading.Thread(target=self._notify, args=(listener,), name="ending-notice", daemon=True).start()

    def requested(self) -> bool:
        """Return whether a stop is requested; the time budget starts with the first such call."""
        if self._begun_s is None and self._stop():
            self.begin()
        return self._begun_s is not None

    def begin(self) -> None:
        """Let the time run from now on, if it does not yet."""
        if self._begun_s is None:
            self._begun_s = self._clock()
            self._begun.set()

    def may_park(self) -> bool:
        """Return whether heads may still be on their way to where they are parked."""
        return self._begun_s is not None and self._clock() < self._begun_s + self.parking_s

    def left_s(self, most_s: float) -> float:
        """Return what a step may take, s: at most ``most_s``, and what is left but for the files."""
        if self._begun_s is None:
            return most_s
        left_s = self._begun_s + self.bound_s - _FILES_S - self._clock()
        return min(most_s, max(left_s, _LEAST_S))

    def watch_recorder(self, written: Callable[[], int]) -> None:
        """From now on the recorder is closing; ``written`` is how many bytes the disk has taken."""
        self._written = written

    def watch(self) -> None:
        """Monitor the deadline in a thread until `done`."""
        threading.Thread(target=self._watch, name="ending", daemon=True).start()

    def done(self) -> None:
        """Stop monitoring: the shutdown is complete."""
        self._done.set()
        self._begun.set()

    def overdue(self) -> bool:
        """Return whether the deadline has passed and the recorder has stopped writing."""
        now_s, written = self._clock(), self._written()
        if written != self._newest:
            self._newest, self._moved_s = written, now_s
        if not self.requested() or self._begun_s is None or now_s < self._begun_s + self.bound_s:
            return False
        return written == 0 or now_s - self._moved_s > _STALLED_S

    def _notify(self, listener: Callable[[], None]) -> None:
        self._begun.wait()
        if not self._done.is_set():
            listener()

    def _watch(self) -> None:
        while not self._done.wait(_LOOK_S):
            if self.overdue() and self._force_exit is not None:
                recorded = ", groundstation recover makes the recording whole" if self._newest > 0 else ""
                self._force_exit(
                    f"did not end within {self.bound_s:g} s and is ended by force; the heads' processes halt them now"
                    + recorded
                )
                return
