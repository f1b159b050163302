"""The end of the process while threads run: the interpreter is then not taken apart.

A daemon thread that comes back from a C++ library after the interpreter has ended is unwound through destructors that
may not throw, and the process aborts: "terminate called without an active exception", exit by SIGABRT, two times of six
for a thread within OpenCV. An interrupt between a thread's start and the `with` block that joins it leaves such one.
"""

import atexit
import errno
import os
import sys
import threading
from typing import NoReturn

# the interpreter's own where standard output cannot be written
_OUTPUT_LOST = 120


class InterpreterExit:
    """Ends the process with ``code`` once all other exit functions have run, if there are threads besides those before.

    Made before anything else registers an exit function: the first registered is the last to run. While ``code`` is
    None, the interpreter's own end remains.
    """

    def __init__(self) -> None:
        self.code: int | None = None
        self._threads_before = frozenset(threading.enumerate())
        atexit.register(self._exit_if_threads_run)

    def _exit_if_threads_run(self) -> None:
        if self.code is not None and not self._threads_before.issuperset(threading.enumerate()):
            leave(self.code)


def leave(code: int) -> NoReturn:
    """End the process now, without exit functions and without taking the interpreter apart.

    That takes half a second of a core with all its libraries, and longer on a busy machine. Output that a full disk
    does not take makes ``code`` that of the interpreter; a terminal or a reader that is gone changes nothing.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as fault:
            if fault.errno == errno.ENOSPC:
                code = code or _OUTPUT_LOST
        except ValueError:
            # closed
            pass
    os._exit(code)
