"""Tests draw and decode thousands of pictures: the C library keeps the memory of freed ones for the next.

By default it returns what is freed to the kernel, which clears each page before it is used again: 8 % of the processor
time of a replay, and more where pictures are drawn.
"""

import ctypes
import os

# the numbers are those of glibc's malloc.h; it takes no higher limit for what is mapped by itself than 32 MB
_PARAMETERS = (
    ("MALLOC_TRIM_THRESHOLD_", -1, 1 << 28),
    ("MALLOC_TOP_PAD_", -2, 1 << 24),
    ("MALLOC_MMAP_THRESHOLD_", -3, 1 << 25),
)


def keep_freed_memory() -> None:
    """Set it for this process, and by the environment for the programs that tests start; a value that is set stays."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    for name, number, size in _PARAMETERS:
        os.environ.setdefault(name, str(size))
        if mallopt is not None:
            mallopt(number, int(os.environ[name]))


def usual_environment() -> dict[str, str]:
    """Return the environment for a program whose memory is tested: as users start it."""
    return {name: value for name, value in os.environ.items() if name not in {name for name, *_ in _PARAMETERS}}
