"""Memory that goes back to the system: a station in operation is to need at noon what it needed in the morning.

The C library's allocator (glibc) learns from the first picture that is let go to keep the memory of all later ones in
its heap, and has a heap for every thread; whatever small thing lies behind a picture then keeps it from going back.
"""

import ctypes
import sys

# glibc's malloc.h
_M_MMAP_THRESHOLD, _M_ARENA_MAX = -3, -8
_PICTURE_BYTES = 256 * 1024
_ARENAS = 2


def configure_allocator() -> bool:
    """Give each picture memory of its own, and all threads two heaps; False where the allocator is another."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    # reported once, a threshold is no longer learnt
    return all([mallopt(_M_MMAP_THRESHOLD, _PICTURE_BYTES), mallopt(_M_ARENA_MAX, _ARENAS)])
