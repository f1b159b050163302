"""What child processes of the tests run: in a module of its own, since a child imports all that its target's needs."""

import signal
import time
from typing import Any


def wait_for_word(pipe: Any) -> None:
    """Report, and end with the first message."""
    pipe.send("here")
    pipe.recv()


def ignore_everything(pipe: Any) -> None:
    """Report, and continue after any signal, SIGTERM too."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    pipe.send("here")
    while True:
        time.sleep(1.0)
