"""Protocol-specific options: names and types are checked."""

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

from ptu_drivers.errors import ProtocolError

_Options = TypeVar("_Options")
_WANTED = {int: "a whole number", float: "a number", bool: "true or false", str: "a word"}


def parse_options(kind: type[_Options], protocol: str, given: Mapping[str, object]) -> _Options:
    """Return the protocol's options, a dataclass whose fields all have defaults. Raises ProtocolError."""
    check_options(protocol, given, {f.name: f.type for f in fields(kind)})  # type: ignore[arg-type]
    return kind(**given)


def check_options(protocol: str, given: Mapping[str, object], kinds: Mapping[str, Any]) -> None:
    """Return if each option is known and of its kind. Raises ProtocolError."""
    unknown = [name for name in given if name not in kinds]
    if unknown:
        raise ProtocolError(f"{protocol} options", got=", ".join(unknown), wanted=", ".join(kinds))
    for name, value in given.items():
        if not _fits(value, kinds[name]):
            wanted = _WANTED.get(kinds[name], "a table of numbers by number")
            raise ProtocolError(f"{protocol} option {name}", got=repr(value), wanted=wanted)


def _fits(value: object, kind: object) -> bool:
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool)
    if isinstance(kind, type):
        return isinstance(value, kind)
    numbers = isinstance(value, Mapping)
    return numbers and all(_fits(k, int) and _fits(v, float) for k, v in value.items())  # type: ignore[attr-defined]
