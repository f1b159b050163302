"""What child processes of the tests run: in a module of its own, since a child imports all that its target's needs."""

import signal
import time
from typing import Any

from ptu_drivers.deferred_termination import DeferredTermination


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


def leave_by_termination(pipe: Any) -> None:
    """Report, and continue until SIGTERM, as a process that opens its units."""
    DeferredTermination().install()
    pipe.send("here")
    while True:
        time.sleep(1.0)


def defer_termination(pipe: Any) -> None:
    """Report, and continue after SIGTERM, as a process at work that reads nothing."""
    termination = DeferredTermination()
    with termination.deferred():
        termination.install()
        pipe.send("here")
        while True:
            time.sleep(1.0)


def note_blocked_signals(config: Any, _blocks: Any, _pipes: Any, control: Any) -> None:
    """Write down the signals that are blocked, in place of a simulated range, and end when asked to."""
    blocked = " ".join(str(int(s)) for s in signal.pthread_sigmask(signal.SIG_BLOCK, []))
    (config.folder / "blocked").write_text(blocked, encoding="ascii")
    control.send(0.0)
    while control.recv() != "stop":
        pass
