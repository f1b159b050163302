"""Halting a unit on every way out of the program, and when commands stop."""

import atexit
import contextlib
import signal
import threading
import weakref
from collections.abc import Callable
from types import FrameType
from typing import Protocol

_SIGNALS = (signal.SIGTERM, signal.SIGHUP)


class _Closable(Protocol):
    def close(self) -> None: ...


_open: "weakref.WeakSet[_Closable]" = weakref.WeakSet()
_registered = False


def halt_on_exit(unit: _Closable) -> None:
    """Close (and so halt) this unit when the program ends: normally, by an exception, Ctrl-C, SIGTERM or SIGHUP.

    SIGTERM and SIGHUP become `SystemExit`, so that every `with` is left in order; a program that handles them itself
    keeps its own handlers. Nothing can be done in this process against SIGKILL.
    """
    global _registered  # noqa: PLW0603 - one exit for the process
    _open.add(unit)
    if not _registered:
        _registered = True
        atexit.register(_close_all)
    if threading.current_thread() is threading.main_thread():
        for number in _SIGNALS:
            if signal.getsignal(number) is signal.SIG_DFL:
                signal.signal(number, _leave)


def _leave(number: int, _frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _close_all() -> None:
    for unit in list(_open):
        # the last lines of the program: whatever one unit does, the others are halted too
        with contextlib.suppress(Exception):
            unit.close()


class Watchdog:
    """Calls `check` a few times a second in a separate thread, until `stop`."""

    def __init__(self, check: Callable[[], None], interval_s: float) -> None:
        self._stop = threading.Event()
        self._check = check
        self._interval_s = interval_s
        self._thread = threading.Thread(target=self._run, name="ptu-watchdog", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread; does not wait for it, which may itself be closing the unit."""
        self._stop.set()

    def _run(self) -> None:
        while not self._stop.wait(self._interval_s):
            self._check()
