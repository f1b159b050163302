"""Refusals are one printable line, whatever was refused."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest


def complaint(kind: type[Exception], action: Callable[[], object]) -> str:
    """Return the message with which `action` refuses; the test fails if it does not."""
    with pytest.raises(kind) as caught:
        action()
    message = str(caught.value)
    assert message.isprintable(), message
    return message


@contextmanager
def only(kind: type[Exception]) -> Iterator[list[str]]:
    """Let errors of one kind happen and collect their messages; all others are raised."""
    reported: list[str] = []
    try:
        yield reported
    except kind as fault:
        reported.append(str(fault))
    assert all(message.isprintable() for message in reported), reported
