"""Ctrl-C while a command runs: it is never lost, and never becomes a traceback.

Python raises KeyboardInterrupt wherever the main thread happens to be. In a destructor or a callback of a library it
would be printed with a traceback and forgotten, and in a module that is being imported it may become another error.
"""

import signal
import sys
from types import FrameType, TracebackType
from typing import TYPE_CHECKING

from groundstation.cli.later_signal import in_llvm, send_again
from groundstation.cli.terminated import Terminated

if TYPE_CHECKING:
    from sys import UnraisableHookArgs


class Interrupts:
    """A context that keeps account of interrupts; one that falls where none can be raised is raised again.

    ``received`` says whether there was one. Once the context has ended, further ones are ignored: the command is done,
    and Python takes itself apart.
    """

    def __init__(self) -> None:
        self.received = False
        self._hook_before = sys.unraisablehook

    def __enter__(self) -> "Interrupts":
        # where it is ignored (a background job of a shell), it stays ignored
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, self._on_interrupt)
        sys.unraisablehook = self._on_unraisable
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Python still destroys what the interrupt has left half made
        sys.unraisablehook = self._after_interrupt if self.received else self._hook_before

    def _on_interrupt(self, _: int, frame: FrameType | None) -> None:
        self.received = True
        if in_llvm(frame):
            send_again(signal.SIGINT)
            return
        raise KeyboardInterrupt

    def _on_unraisable(self, lost: "UnraisableHookArgs") -> None:
        if lost.exc_type is not None and issubclass(lost.exc_type, KeyboardInterrupt):
            # not from here: a hook is another place that an interrupt cannot leave
            number = signal.SIGTERM if issubclass(lost.exc_type, Terminated) else signal.SIGINT
            send_again(number)
        else:
            self._after_interrupt(lost)

    def _after_interrupt(self, lost: "UnraisableHookArgs") -> None:
        """Report it, but for a destructor that misses what an interrupted constructor has not set."""
        half_made = lost.exc_type is not None and issubclass(lost.exc_type, AttributeError)
        if not (self.received and half_made):
            self._hook_before(lost)
