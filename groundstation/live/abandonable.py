"""A step of the preparation that looks for no request to stop, and is left where one comes."""

import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import TypeVar

T = TypeVar("T")
_LOOK_S = 0.1


def abandonable(step: Callable[[], T], stop: Callable[[], bool]) -> T:
    """Return what a step returns, taken in a thread; raises KeyboardInterrupt for a stop, and lets the step run on."""
    found: Future[T] = Future()

    def take() -> None:
        try:
            found.set_result(step())
        except BaseException as fault:  # noqa: BLE001 - raised again where it is waited for
            found.set_exception(fault)

    threading.Thread(target=take, name="step", daemon=True).start()
    while not found.done():
        wait([found], _LOOK_S)
        if stop():
            raise KeyboardInterrupt
    return found.result()
