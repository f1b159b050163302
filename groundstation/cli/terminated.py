"""SIGTERM ends a command as Ctrl-C does, with its own exit code: what is half done is removed."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from groundstation.cli.later_signal import in_llvm, send_again

TERMINATED = 128 + signal.SIGTERM


class Terminated(KeyboardInterrupt):
    """The command was asked to end by SIGTERM."""


@contextmanager
def ended_in_order() -> Iterator[None]:
    """Raise `Terminated` in the main thread on SIGTERM, unless the program handles or ignores it otherwise."""
    if signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, _raise)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _raise(_: int, frame: FrameType | None) -> None:
    if in_llvm(frame):
        send_again(signal.SIGTERM)
        return
    raise Terminated
