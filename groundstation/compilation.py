"""What numba compiles, while it compiles: told to the display that watches.

Kernels are compiled at their first use and kept in numba's cache, so that this is one run in many. Work in another
process reaches the display by `compilation_sent` there and `reported` here.
"""

import gc
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_PACKAGES = ("groundstation.", "calibration.")
_lock = threading.Lock()
_watchers: list[Callable[["Compiling"], None]] = []
_listeners: list[Any] = []


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiling:
    """A kernel whose compilation begins.

    Attributes
    ----------
    kernel : module and name, without the package.
    number : of the kernel in this process, from 1. at_most : as many may have to be compiled.
    """

    kernel: str
    number: int
    at_most: int


@contextmanager
def compilation_watched(tell: Callable[[Compiling], None]) -> Iterator[None]:
    """Tell of each kernel that is compiled meanwhile; of several displays, the last one that began is told.

    ``tell`` is called by the thread that compiles.
    """
    with _lock:
        _watchers.append(tell)
    try:
        yield
    finally:
        with _lock:
            _watchers.remove(tell)


@contextmanager
def compilation_sent(send: Callable[[Compiling], None]) -> Iterator[None]:
    """Send what this process compiles meanwhile to the process that began it, which may have ended."""

    def tell(what: Compiling) -> None:
        with suppress(OSError):
            send(what)

    listen()
    with compilation_watched(tell):
        yield


def reported(message: Any) -> Any:
    """Return what another process has sent, or None after it was told to the display."""
    if not isinstance(message, Compiling):
        return message
    report(message)
    return None


def report(compiling: Compiling) -> None:
    """Tell the display, if there is one."""
    with _lock:
        tell = _watchers[-1] if _watchers else None
    if tell is not None:
        tell(compiling)


def listen() -> None:
    """Have numba report what it compiles from now on, in this process; imports numba."""
    if _listeners:
        return
    from numba.core import event

    class Kernels(event.Listener):
        """Reports this project's kernels."""

        def __init__(self) -> None:
            self._begun: set[str] = set()
            self._at_most = 0

        def on_start(self, event: Any) -> None:
            """Report a kernel, the first time; a display that fails does not stop what is compiled."""
            with suppress(Exception):
                self._report(event)

        def _report(self, event: Any) -> None:
            # another signature is no other kernel
            function = event.data["dispatcher"].py_func
            name = f"{function.__module__}.{function.__qualname__}"
            if not name.startswith(_PACKAGES) or name in self._begun:
                return
            self._begun.add(name)
            if len(self._begun) > self._at_most:
                # others may have been imported since
                self._at_most = len(self._begun) - 1 + len(_uncompiled() | {name})
            report(
                Compiling(kernel=name.partition(".")[2], number=len(self._begun), at_most=self._at_most),
            )

        def on_end(self, event: Any) -> None:
            """Do nothing: the next one is told of at its start."""

    _listeners.append(Kernels())
    event.register("numba:compile", _listeners[0])  # type: ignore[no-untyped-call]


def _uncompiled() -> set[str]:
    """Return the names of the kernels in memory that are neither compiled nor in numba's cache."""
    from numba.core.registry import CPUDispatcher

    kernels = [found for found in gc.get_objects() if issubclass(type(found), CPUDispatcher) and not found.signatures]
    named = {f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}": kernel for kernel in kernels}
    return {name for name, kernel in named.items() if name.startswith(_PACKAGES) and not _is_cached(kernel)}


def _is_cached(kernel: Any) -> bool:
    """Return whether numba's cache has an index of a kernel that is not older than its source."""
    source = Path(kernel.py_func.__code__.co_filename)
    try:
        indices = list(Path(kernel.stats.cache_path).glob(f"{source.stem}.{kernel.py_func.__qualname__}-*.nbi"))
        return bool(indices) and indices[0].stat().st_mtime >= source.stat().st_mtime
    except (OSError, TypeError):
        return False
