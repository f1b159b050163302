"""Signals that come at a place where they cannot end a command: they are sent again a little later."""

import signal
import threading
from types import FrameType

# longer than a destructor or a callback, and short for who waits
_AGAIN_S = 0.02


def in_llvm(frame: FrameType | None) -> bool:
    """Return whether LLVM is being called: an object whose owner is not noted yet would be freed twice, a crash."""
    while frame is not None:
        if str(frame.f_globals.get("__name__", "")).startswith("llvmlite."):
            return True
        frame = frame.f_back
    return False


def send_again(number: signal.Signals) -> None:
    """Send the main thread a signal in a while."""
    again = threading.Timer(_AGAIN_S, _signal_main_thread, (number,))
    again.daemon = True
    again.start()


def _signal_main_thread(number: signal.Signals) -> None:
    """Send it a true signal, which also ends a system call that waits."""
    signal.pthread_kill(threading.main_thread().ident or 0, number)
