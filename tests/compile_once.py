"""Workers that need the same kernel at the same time: one compiles it, the others wait and read it from the cache.

Without this three of them compile all of it, each for itself; and two that keep different kinds of one kernel at the
same moment may give both the same file.
"""

import contextlib
import fcntl
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

_held: set[Path] = set()


@contextlib.contextmanager
def alone(path: Path) -> Iterator[None]:
    """Wait until no other process is in here with this path; a process that is may enter again."""
    if path in _held:
        yield
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        _held.add(path)
        try:
            yield
        finally:
            _held.discard(path)


def compile_once() -> None:
    """Let every kernel that is kept on disk be compiled by one process at a time."""
    compile_alone = Dispatcher.compile

    def compile_in_turn(self: Any, sig: Any) -> Any:
        folder = getattr(self._cache, "cache_path", None)
        if folder is None:
            return compile_alone(self, sig)
        # kernels call kernels, never in a circle; the compiler's own lock first, or two threads wait for each other
        with global_compiler_lock, alone(Path(folder) / f"{self.py_func.__module__}.{self.py_func.__qualname__}.lock"):
            return compile_alone(self, sig)

    Dispatcher.compile = compile_in_turn
