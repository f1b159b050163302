"""An argument whose text cannot be right is wrong usage, exit code 2, whichever reader refuses it."""

import argparse
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from groundstation.errors import InputError, UsageError


@contextmanager
def refused_as_usage() -> Iterator[None]:
    """Raise the `InputError` of a reader of arguments as `UsageError`, with the same words."""
    try:
        yield
    except InputError as fault:
        raise UsageError(fault.where, got=fault.got, wanted=fault.wanted) from fault


def refuse_with(options: argparse.Namespace, option: str, ignored: Mapping[str, object], why: str) -> None:
    """Raise `UsageError` for an option that has no meaning next to another.

    ``ignored`` has the names of the options in the namespace, with their defaults; ``why`` completes "one of them:".
    """
    for name, default in ignored.items():
        if getattr(options, name) != default:
            raise UsageError(f"--{name.replace('_', '-')}", got=f"{option} as well", wanted=f"one of them: {why}")


def refuse_without(options: argparse.Namespace, option: str, dependent: Mapping[str, object]) -> None:
    """Raise `UsageError` for an option that has a meaning only together with another, which was not given."""
    for name, default in dependent.items():
        if getattr(options, name) != default:
            raise UsageError(f"--{name.replace('_', '-')}", got=f"no {option}", wanted="both, or neither")
