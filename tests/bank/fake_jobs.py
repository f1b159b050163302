"""Cheap jobs for the runner's tests: they compute, raise, crash and hang as their items say."""

import ctypes
import os
import signal
import time
from pathlib import Path
from typing import Any


def square(item: int) -> dict[str, Any]:
    return {"item": item, "square": item * item, "third": item / 3.0}


def misbehave(item: str) -> str:
    """Return the item, or execute the action that it names."""
    match item.split(":"):
        case ["raise"]:
            raise ValueError("no such runway")
        case ["crash"]:
            ctypes.string_at(0)
        case ["hang"]:
            hang()
        case ["unreadable"]:
            return object()  # type: ignore[return-value] # no JSON
        case ["killed once", path]:
            if not Path(path).exists():
                Path(path).touch()
                os.kill(os.getpid(), signal.SIGKILL)
    return item


def hang() -> None:
    time.sleep(600.0)


def slow_square(item: tuple[int, str]) -> dict[str, Any]:
    """Return a square after a moment, and leave a mark of each time that it is computed."""
    number, marks = item
    time.sleep(0.25)
    with (Path(marks) / f"{number}").open("a") as file:
        file.write(f"{os.getpid()}\n")
    return square(number)
