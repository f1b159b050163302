"""A rule that can be left out of a run: which attribute of the program takes which other value meanwhile."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest import mock


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """A rule of the program, and how a run goes without it.

    Attributes
    ----------
    name : of the rule, as in the table of docs/notes/detection.md.
    where : the module or the class that has the attribute ``attribute``.
    without : from the attribute to what stands in its place.
    """

    name: str
    where: Any
    attribute: str
    without: Callable[[Any], Any]

    @contextmanager
    def left_out(self) -> Iterator[None]:
        """Run the block without the rule."""
        with mock.patch.object(self.where, self.attribute, self.without(vars(self.where)[self.attribute])):
            yield


def always(value: Any) -> Callable[[Any], Any]:
    """Return what puts a function in an attribute's place that returns ``value`` of any arguments."""
    return lambda before: lambda *arguments, **named: value


def constant(value: Any) -> Callable[[Any], Any]:
    """Return what puts ``value`` in an attribute's place."""
    return lambda before: value


def first_of(before: Any) -> Any:
    """Return a function that returns its first argument."""
    return lambda first, *arguments, **named: first
