"""How threads share the interpreter and the processors: the pipeline comes first, the others soon."""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_HAND_OVER_S = 2e-4
_NICE = 5  # a third of the pipeline's share of a processor that both want


@contextmanager
def short_gil_switch_interval() -> Iterator[None]:
    """Inside, let threads that need the interpreter only for moments have it soon.

    Decoders, cameras and serial lines need it for microseconds at a time. With Python's 5 ms of patience they wait, and
    a core idles or an instant is missed, while the pipeline computes.
    """
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(_HAND_OVER_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before_s)


def give_way() -> bool:
    """Let the calling thread compute where the pipeline leaves room; False where a thread has no rank of its own.

    Decoders and writers work ahead or behind by a few frames, in bounded queues. Sharing a core with it on equal
    terms they push the pipeline out in the middle of a pair, and what it had in the core's cache goes with it.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        # on Linux a thread's number stands for that thread alone, unlike POSIX's rule for processes
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), os.getpriority(os.PRIO_PROCESS, 0) + _NICE)
    except OSError:
        return False
    return True
