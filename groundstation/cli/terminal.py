"""Lines on the terminal; a terminal that is closed does not stop the program."""

import contextlib
import os
from typing import TextIO


def print_line(text: str, stream: TextIO) -> None:
    """Print and flush a line; if this fails (closed terminal, full disk), it and all further lines are discarded.

    The stream is then redirected to the null device, so that flushing its buffer at exit does not fail again.
    """
    try:
        print(text, file=stream, flush=True)
    except OSError:
        with contextlib.suppress(OSError):
            null = os.open(os.devnull, os.O_WRONLY)
            try:
                os.dup2(null, stream.fileno())
            finally:
                os.close(null)
