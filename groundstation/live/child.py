"""Processes of a station in operation: what a terminal tells the whole group, only the first is to hear."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

_OF_THE_GROUP = {signal.SIGINT, signal.SIGHUP}


@contextmanager
def deaf_to_the_terminal() -> Iterator[None]:
    """What is begun inside never hears SIGINT or SIGHUP, not even while it starts; whoever began it ends it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _OF_THE_GROUP)
    try:
        # the library's own process outlives all others; starting it opens this one's ears again
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, _OF_THE_GROUP)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
