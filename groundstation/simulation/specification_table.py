"""Specifications as tables of plain values: frozen dataclasses to TOML and back, checked field by field.

A field with a name in ``_rad`` is in degrees in the file, with the suffix ``_deg``; every other value is stored as
it is. None is an absent key. A file that is read and written again is the same, and gives the same specification to the
last bit.
"""

import dataclasses
import json
import math
import types
import typing
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any, TypeVar

from groundstation.errors import ConfigError, ScenarioError
from groundstation.files.toml_table import TomlTable, finite_number, quoted

SpecificationT = TypeVar("SpecificationT")
_DRAWN_DIGITS = 6


def specification_table(specification: Any) -> dict[str, Any]:
    """Return a specification as nested tables of plain values, ready for `toml_text`."""
    table: dict[str, Any] = {}
    for field in dataclasses.fields(specification):
        value = getattr(specification, field.name)
        if value is not None:
            table[_key(field.name)] = _plain(value, _is_angle(field.name))
    return table


def rounded(specification: SpecificationT) -> SpecificationT:
    """Return a specification with numbers of six digits, so that the file of a drawn world is readable."""
    changes = {
        f.name: _round(getattr(specification, f.name), _is_angle(f.name))
        for f in dataclasses.fields(specification)  # type: ignore[arg-type]
    }
    return dataclasses.replace(specification, **changes)  # type: ignore[type-var]


def read_specification(kind: type[SpecificationT], table: TomlTable) -> SpecificationT:
    """Read a specification of one class; absent keys take the class's defaults.

    Raises `ConfigError` that names file, table and key.
    """
    hints = typing.get_type_hints(kind)
    found = dataclasses.fields(kind)  # type: ignore[arg-type]
    table.refuse_unknown({_key(field.name) for field in found})
    values: dict[str, Any] = {}
    for field in found:
        key = _key(field.name)
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if key in table:
            values[field.name] = _read(hints[field.name], table, key, table.values[key], _is_angle(field.name))
        elif _optional(hints[field.name]) is not None and required:
            values[field.name] = None
        elif required:
            raise table.fail(key, "nothing", _wanted(hints[field.name]))
    try:
        return kind(**values)
    except ScenarioError as fault:
        raise ConfigError(f"{table.where}: {fault.where}", got=fault.got, wanted=fault.wanted) from fault


def toml_text(table: Mapping[str, Any], path: str = "") -> str:
    """Return nested tables as TOML: own values first, then tables, then arrays of tables."""
    own = [f"{key} = {_toml_value(value)}" for key, value in table.items() if not _nested(value)]
    blocks = ["\n".join(([f"[{path}]"] if path else []) + own)] if own or path else []
    for key, value in table.items():
        inner = f"{path}.{key}" if path else key
        if isinstance(value, Mapping):
            blocks.append(toml_text(value, inner))
        elif _nested(value):
            blocks += [toml_text(row, inner).replace(f"[{inner}]", f"[[{inner}]]", 1) for row in value]
    return "\n\n".join(block for block in blocks if block)


def _is_angle(name: str) -> bool:
    return name.endswith("_rad")


def _key(name: str) -> str:
    return name.removesuffix("_rad") + "_deg" if _is_angle(name) else name


def _nested(value: Any) -> bool:
    rows = isinstance(value, list) and bool(value) and all(isinstance(row, Mapping) for row in value)
    return isinstance(value, Mapping) or rows


def _plain(value: Any, angle: bool) -> Any:
    if dataclasses.is_dataclass(value):
        return specification_table(value)
    if isinstance(value, tuple):
        return [_plain(v, angle) for v in value]
    if isinstance(value, StrEnum):
        return value.value
    return _degrees(value) if angle else value


def _degrees(value: float) -> float:
    """Return the shortest angle in degrees that is read as this one."""
    exact = math.degrees(value)
    for digits in range(_DRAWN_DIGITS, 18):
        short = float(f"{exact:.{digits}g}")
        if math.radians(short) == value:
            return short
    return exact


def _round(value: Any, angle: bool) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return rounded(value)
    if isinstance(value, tuple):
        return tuple(_round(v, angle) for v in value)
    if not isinstance(value, float):
        return value
    if angle:
        return math.radians(float(f"{math.degrees(value):.{_DRAWN_DIGITS}g}"))
    return float(f"{value:.{_DRAWN_DIGITS}g}")


def _optional(hint: Any) -> Any:
    """Return X of ``X | None``; None for another hint."""
    if isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union:
        inner = [arm for arm in typing.get_args(hint) if arm is not type(None)]
        return inner[0] if len(inner) == 1 else None
    return None


def _read(hint: Any, table: TomlTable, key: str, value: Any, angle: bool) -> Any:
    """Return one value of a file, converted to the type hint."""
    inner = _optional(hint)
    if inner is not None:
        return _read(inner, table, key, value, angle)
    if typing.get_origin(hint) is tuple:
        return _read_tuple(typing.get_args(hint), table, key, value, angle)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return read_specification(hint, TomlTable(value, f"{table.where}: {key}", table.error))
    if isinstance(hint, type) and issubclass(hint, StrEnum):
        if value not in [kind.value for kind in hint]:
            raise table.fail(key, quoted(value), _wanted(hint))
        return hint(value)
    if hint is float:
        number = finite_number(value)
        if number is None:
            raise table.fail(key, quoted(value), _wanted(hint))
        return math.radians(number) if angle else number
    if not isinstance(value, hint) or (hint is int and isinstance(value, bool)):
        raise table.fail(key, quoted(value), _wanted(hint))
    return value


def _read_tuple(arms: Sequence[Any], table: TomlTable, key: str, value: Any, angle: bool) -> tuple[Any, ...]:
    """Return a list of a file as a tuple, of one type and any length or of a type for each place."""
    repeated = len(arms) == 2 and arms[1] is Ellipsis
    if not isinstance(value, list) or (not repeated and len(value) != len(arms)):
        wanted = f"a list of {_wanted(arms[0])}" if repeated else f"a list of {len(arms)} values"
        raise table.fail(key, quoted(value), wanted)
    kinds = [arms[0]] * len(value) if repeated else arms
    return tuple(
        _read(kind, table, f"{key}[{k + 1}]", v, angle) for k, (kind, v) in enumerate(zip(kinds, value, strict=True))
    )


def _wanted(hint: Any) -> str:
    """Return in words what a type hint accepts."""
    inner = _optional(hint)
    if inner is not None:
        return _wanted(inner)
    if isinstance(hint, type) and issubclass(hint, StrEnum):
        return "one of " + ", ".join(repr(kind.value) for kind in hint)
    words = {float: "a finite number", int: "a whole number", str: "a string", bool: "true or false"}
    return words.get(hint, "a table" if dataclasses.is_dataclass(hint) else "a list")


def _toml_value(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if not isinstance(value, str):
        return repr(value)
    # TOML refuses this one control character, which JSON does not escape
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
