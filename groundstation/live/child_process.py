"""Child processes of a live station, shielded from signals that the terminal and SIGTERM's senders give the group."""

import multiprocessing as mp
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

# Ctrl-C, a closed window, Ctrl-Z and Ctrl-\: a head that turns must not lose its process to a key
_OF_THE_GROUP = {signal.SIGINT, signal.SIGHUP, signal.SIGTSTP, signal.SIGQUIT}
_BY_SIGNAL = 128
# what the library's own process would print after a forced end, about memory that it has given back
_TRACKER_QUIET = "ignore::UserWarning:multiprocessing.resource_tracker"
# a killed process is gone at once, unless it waits for a device in the kernel
_KILLED_S = 0.3


@contextmanager
def terminal_signals_blocked() -> Iterator[None]:
    """Start processes with the terminal's signals blocked from the start; the parent ends them."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _OF_THE_GROUP)
    try:
        # the library's own process outlives all others; starting it opens this one's ears again
        _start_tracker()
        signal.pthread_sigmask(signal.SIG_BLOCK, _OF_THE_GROUP)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def group_signals_blocked() -> Iterator[None]:
    """Start processes with the terminal's signals blocked, and SIGTERM until the process itself unblocks it.

    While it reads its modules it could only die by it, which ends a station that is to end in order.
    """
    with terminal_signals_blocked():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start_tracker() -> None:
    """Start the process that gives back shared memory after a forced end, unless it runs; it does so quietly."""
    sys.warnoptions.append(_TRACKER_QUIET)
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.remove(_TRACKER_QUIET)


class ChildProcess:
    """A process of the station with a pipe to it, which it gets as its last argument.

    It is a daemon, hears nothing of the terminal, and sees the pipe's end when this process is gone. SIGTERM waits
    until the target handles it (`DeferredTermination`).
    """

    def __init__(self, name: str, target: Callable[..., None], *given: Any) -> None:
        context = mp.get_context("spawn")
        # a pipe that is closed while another thread sends would be used with no handle
        self._using = threading.Lock()
        self.pipe: Connection
        self.pipe, other = context.Pipe()
        self._process: BaseProcess = context.Process(
            target=_named, args=(name, target, *given, other), name=name, daemon=True
        )
        with group_signals_blocked():
            self._process.start()
        other.close()

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid or 0

    @property
    def sentinel(self) -> int:
        """What `multiprocessing.connection.wait` takes to see it end."""
        return self._process.sentinel

    def is_alive(self) -> bool:
        """Return whether it has not ended."""
        return self._process.is_alive()

    def send(self, what: object) -> bool:
        """Send something; False where the other side is gone."""
        with self._using:
            try:
                self.pipe.send(what)
            except OSError:
                return False
        return True

    def end(self, ask: object, ask_s: float, terminate_s: float) -> bool:
        """Ask it to end, then terminate it, then kill it; returns whether it ended by itself before it was killed.

        A target that defers SIGTERM (`DeferredTermination`) handles requests meanwhile; one that opens its devices or
        has been asked, and is not done, leaves by it.
        """
        self.send(ask)
        self._process.join(ask_s)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join(terminate_s)
        by_itself = not self._process.is_alive()
        self.kill()
        return by_itself

    def kill(self, grace_s: float = 0.0) -> None:
        """Kill it, stopped or not, unless it ends within ``grace_s``, and close the pipe."""
        self._process.join(grace_s)
        if self._process.is_alive():
            self._process.kill()
        self._process.join(_KILLED_S)
        # a blocked send has failed by now, without a reader
        with self._using:
            self.pipe.close()

    def exit_description(self) -> str:
        """Return in a few words how it ended: by which signal, or with which exit code."""
        code = self._process.exitcode
        if code is None:
            return "has not ended"
        # a program that ended in order after SIGTERM returns 128 and the signal's number
        number = -code if code < 0 else code - _BY_SIGNAL
        try:
            return f"was ended by {signal.Signals(number).name}"
        except ValueError:
            return f"ended with exit code {code}"


def _named(name: str, target: Callable[..., None], *given: Any) -> None:
    """Call ``target`` in a process that ``top`` and ``ps`` show by its name, and end the process when it returns.

    It has let go of all that it had; taking the interpreter apart would only take time, while others wait for its end.
    """
    with suppress(OSError):
        Path("/proc/self/comm").write_text(name, encoding="ascii")
    code = 0
    try:
        target(*given)
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 1
    os._exit(code)
