"""The tuning as TOML with a comment on each key: its meaning, from the docstrings, and the values that it takes.

The bounds of a number are found by trying values: what the tuning's own checks refuse is outside of them.
"""

import dataclasses
import inspect
import re
import textwrap
from collections.abc import Callable
from enum import StrEnum
from types import NoneType
from typing import Any, get_args, get_origin

from groundstation.errors import ConfigError
from groundstation.tracking.config import (
    config_from_mapping,
    config_to_mapping,
    config_to_toml,
    describe_type,
    type_hints,
)

_WIDTH = 100
_ENTRY = re.compile(r"^([a-z_0-9]+(?:, [a-z_0-9]+)*) : (.*)$")
# by the ends of names, the longer ones first
_UNITS = {
    "_psd_m2_s3": "m²/s³",
    "_psd_rad2_s3": "rad²/s³",
    "_sigma_spans": "spans",
    "_deg_s": "deg/s",
    "_m_s": "m/s",
    "_px": "px",
    "_deg": "deg",
    "_m": "m",
    "_s": "s",
}
# beyond it a number has no bound, and the steps of the search for one
_LARGE, _STEPS = 1e8, 100
# ends a search for a bound: six digits are shown, and what is below 1e-9 is zero
_CLOSE = 1e-8


def commented_toml(config: Any, path: str = "") -> str:
    """Return a tuning as TOML: each key with a comment, first a table's own keys, then the tables inside it."""
    blocks, tables = [], []
    meanings = meanings_of(type(config))
    hints = type_hints(type(config))
    values = config_to_mapping(config)
    lines = [f"[{path}]"] if path else []
    for item in dataclasses.fields(config):
        value = getattr(config, item.name)
        if dataclasses.is_dataclass(value):
            tables.append(commented_toml(value, f"{path}.{item.name}" if path else item.name))
            continue
        parts = (meanings.get(item.name, ""), unit_of(item.name), _values(config, item.name, hints))
        comment = "; ".join(part for part in parts if part)
        lines += textwrap.wrap(comment, _WIDTH, initial_indent="# ", subsequent_indent="#   ", break_on_hyphens=False)
        lines.append(config_to_toml({item.name: values[item.name]}) if value is not None else f"# {item.name} = …")
    if len(lines) > bool(path):
        blocks.append("\n".join(lines))
    return "\n\n".join([*blocks, *tables])


def meanings_of(kind: type) -> dict[str, str]:
    """Return what the docstring of a dataclass says of its fields."""
    found: dict[str, str] = {}
    current: tuple[str, ...] = ()
    for line in (inspect.getdoc(kind) or "").splitlines():
        entry = _ENTRY.match(line)
        if entry is not None:
            current = tuple(entry[1].split(", "))
            found |= dict.fromkeys(current, entry[2].strip())
        elif line.startswith("    ") and current:
            found |= {name: f"{found[name]} {line.strip()}" for name in current}
        else:
            current = ()
    return {name: text.replace("``", "").rstrip(" .;") for name, text in found.items()}


def unit_of(name: str) -> str:
    """Return the unit in which a key is, by the end of its name; "" for none."""
    return next((f"in {unit}" for end, unit in _UNITS.items() if name.endswith(end)), "")


def _values(config: Any, name: str, hints: dict[str, Any]) -> str:
    """Return in words which values a key takes."""
    options = [kind for kind in get_args(hints[name]) or (hints[name],) if kind is not NoneType]
    kind = hints[name] if get_origin(hints[name]) is tuple else options[0]
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return describe_type(kind)
    if kind is bool:
        return "true or false"
    if kind in (int, float):
        return _bounds(config, name, whole=kind is int)
    return describe_type(kind)


def _bounds(config: Any, name: str, *, whole: bool) -> str:
    """Return the bounds of a number, the other keys being as they are."""
    value = getattr(config, name)
    table = config_to_mapping(config)

    def accepted(number: float) -> bool:
        try:
            config_from_mapping(type(config), {**table, name: round(number) if whole else number}, "")
        except ConfigError:
            return False
        return True

    start = float(value if value is not None else 1.0)
    least, most = _bound(accepted, start, -_LARGE, whole=whole), _bound(accepted, start, _LARGE, whole=whole)
    words = [_side(accepted, least, "at least", "above"), _side(accepted, most, "at most", "below")]
    return " and ".join(word for word in words if word)


def _side(accepted: Callable[[float], bool], bound: float | None, inside: str, outside: str) -> str:
    """Return one bound in words; "" for none."""
    if bound is None:
        return ""
    return f"{inside if accepted(bound) else outside} {bound:g}"


def _bound(accepted: Callable[[float], bool], start: float, end: float, *, whole: bool) -> float | None:
    """Return the bound between an accepted and a large number; None if there is none."""
    if accepted(end):
        return None
    inside, outside = start, end
    for _ in range(_STEPS):
        middle = 0.5 * (inside + outside)
        if abs(inside - outside) <= _CLOSE * max(abs(middle), 1e-3):
            break
        inside, outside = (middle, outside) if accepted(middle) else (inside, middle)
    if whole:
        return float(round(inside))
    nice = float(f"{0.5 * (inside + outside):.6g}")
    return 0.0 if abs(nice) < 1e-9 else nice
