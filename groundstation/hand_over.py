"""How long a thread computes before another one gets the interpreter."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

_HAND_OVER_S = 2e-4


@contextmanager
def quick_hand_over() -> Iterator[None]:
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
