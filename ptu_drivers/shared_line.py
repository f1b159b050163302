"""A serial line that two programs have open: a unit is halted while the one that drives it may still read."""

import os
import select

_GONE = select.POLLHUP | select.POLLERR | select.POLLNVAL


def is_shared_line(fileno: int) -> bool:
    """Return whether a line without the bytes that it was to have is there all the same: another program took them.

    A connection over a network is of one program: without bytes it is closed.
    """
    if not os.isatty(fileno):
        return False
    state = select.poll()
    state.register(fileno, select.POLLIN)
    return not any(flags & _GONE for _, flags in state.poll(0))
