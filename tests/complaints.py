"""What a refusal says: one printable line, whatever was refused."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest


def complaint(kind: type[Exception], action: Callable[[], object]) -> str:
    """Return what `action` says when it refuses; a failure of the test if it does not."""
    with pytest.raises(kind) as caught:
        action()
    message = str(caught.value)
    assert message.isprintable(), message
    return message


@contextmanager
def only(kind: type[Exception]) -> Iterator[list[str]]:
    """Let errors of one kind happen and collect what they say; all others come through."""
    reported: list[str] = []
    try:
        yield reported
    except kind as fault:
        reported.append(str(fault))
    assert all(message.isprintable() for message in reported), reported
