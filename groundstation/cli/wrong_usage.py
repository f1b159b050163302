"""An argument whose text cannot be right is wrong usage, exit code 2, whichever reader refuses it."""

from collections.abc import Iterator
from contextlib import contextmanager

from groundstation.errors import InputError, UsageError


@contextmanager
def refused_as_usage() -> Iterator[None]:
    """Raise the `InputError` of a reader of arguments as `UsageError`, with the same words."""
    try:
        yield
    except InputError as fault:
        raise UsageError(fault.where, got=fault.got, wanted=fault.wanted) from fault
