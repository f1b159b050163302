"""Lines for whoever is at the terminal; that nobody is there any more stops nothing."""

import contextlib
import os
from typing import TextIO


def print_line(text: str, stream: TextIO) -> None:
    """Print a line at once; where it is not taken (a closed terminal, a full disk), this one and all after it are lost.

    Nothing is left in the stream's buffer that would fail again when the program ends.
    """
    try:
        print(text, file=stream, flush=True)
    except OSError:
        with contextlib.suppress(OSError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            try:
                os.dup2(nowhere, stream.fileno())
            finally:
                os.close(nowhere)
