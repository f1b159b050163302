"""The tuning of the whole pipeline: typed, with documented defaults, read from TOML.

A configuration file holds one table per component (``[detection]``, ``[estimation]``, …); what it leaves out
keeps its default, and a key that does not exist is an error. The resolved configuration is saved with every
output.
"""

import dataclasses
import json
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from groundstation.detection.candidate_finder import AcquisitionConfig
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.errors import ConfigError, InputError
from groundstation.estimation.config import EstimationConfig, InitiationConfig
from groundstation.evaluation.config import EvaluationConfig
from groundstation.files.channel_weights import SHA256, add_weights, channel_weights
from groundstation.files.nearest_word import one_of
from groundstation.files.text_file import TextFile
from groundstation.files.toml_table import load_toml, quoted, shown
from groundstation.integrity.station_exclusion import IntegrityConfig
from groundstation.tracking.synchronise import SynchroniseConfig

T = TypeVar("T")


class TrackStart(StrEnum):
    """How the track begins."""

    AUTO = "auto"  # from [initial] where the session has it, else by searching
    SEARCH = "search"
    INITIAL = "initial"
    DGPS = "dgps"


@dataclass(frozen=True, slots=True, kw_only=True)
class Config:
    """The whole tuning, one table per component.

    Attributes
    ----------
    start : how the track begins; "auto" is from [initial] where the session has it, else by searching.
    """

    start: TrackStart = TrackStart.AUTO
    detection: DetectionConfig = field(default_factory=DetectionConfig)
    acquisition: AcquisitionConfig = field(default_factory=AcquisitionConfig)
    synchronise: SynchroniseConfig = field(default_factory=SynchroniseConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    initiation: InitiationConfig = field(default_factory=InitiationConfig)
    integrity: IntegrityConfig = field(default_factory=IntegrityConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)


def load_config(path: TextFile | None) -> Config:
    """Read a configuration file; None gives the defaults. Raises `ConfigError`."""
    return Config() if path is None else config_from_mapping(Config, load_toml(path, ConfigError), str(path))


def with_weights(config: Config, path: Path | None) -> Config:
    """Return a configuration that detects with one's own weights of the learned channel; None leaves it as it is.

    Raises `InputError` for a file that is none.
    """
    if path is None:
        return config
    sha256 = add_weights(path)
    try:
        LearnedChannel(channel_weights(sha256))
    except InputError as fault:
        raise InputError(str(path), got=fault.got, wanted=fault.wanted) from fault
    named = "" if sha256 == SHA256 else sha256
    detection = dataclasses.replace(config.detection, detector=DetectorKind.LEARNED, weights_sha256=named)
    return dataclasses.replace(config, detection=detection)


_HINTS: dict[type, dict[str, Any]] = {}


def type_hints(kind: type) -> dict[str, Any]:
    """Return the types of a dataclass' fields, found once."""
    if kind not in _HINTS:
        _HINTS[kind] = get_type_hints(kind)
    return _HINTS[kind]


def config_from_mapping(kind: type[T], values: Mapping[str, Any], where: str) -> T:
    """Build the dataclass ``kind`` from a TOML table; raises `ConfigError` for unknown keys or wrong types."""
    hints = type_hints(kind)
    names = {f.name for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    arguments: dict[str, Any] = {}
    for key, value in values.items():
        if key not in names:
            raise ConfigError(f"{where}: {shown(key)}", got="an unknown key", wanted=one_of(key, names))
        arguments[key] = _value(hints[key], value, f"{where}: {key}")
    try:
        return kind(**arguments)
    except ValueError as fault:
        raise _out_of_bounds(kind, arguments, where, str(fault)) from fault


def _out_of_bounds(kind: type, given: Mapping[str, Any], where: str, rule: str) -> ConfigError:
    """Return the error for a rule that values break: with the given ones that it names, or else their defaults."""
    bounds = "a value inside its bounds"
    defaults = {f.name: f.default for f in dataclasses.fields(kind)}
    named = [name for name in defaults if re.search(rf"\b{name}\b", rule)]
    told = [name for name in named if name in given] or named
    if not told or " must " not in rule:
        # the rule itself says what was got
        return ConfigError(where, got=rule, wanted=bounds)
    got = ", ".join(f"{name} = {quoted(_plain(given.get(name, defaults[name])))}" for name in told)
    return ConfigError(where, got=got, wanted=f"{bounds}: {rule}")


def _value(hint: Any, value: Any, where: str) -> Any:
    """Convert one TOML value to the type that the field declares."""
    options = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    for option in options:
        converted = _one(option, value, where)
        if converted is not _NO:
            return converted
    wanted = " or ".join(describe_type(o) for o in options if o is not NoneType)
    raise ConfigError(where, got=quoted(value), wanted=wanted)


_NO = object()


def _one(kind: Any, value: Any, where: str) -> Any:
    """Convert to one concrete type, or return `_NO`."""
    if dataclasses.is_dataclass(kind) and isinstance(kind, type):
        return config_from_mapping(kind, value, where) if isinstance(value, Mapping) else _NO
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return kind(value) if value in [m.value for m in kind] else _NO
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        if not isinstance(value, list):
            return _NO
        if len(parts) == 2 and parts[1] is Ellipsis:
            return tuple(_value(parts[0], v, where) for v in value)
        return (
            tuple(_value(p, v, where) for p, v in zip(parts, value, strict=True)) if len(value) == len(parts) else _NO
        )
    if isinstance(value, bool):
        return value if kind is bool else _NO
    if kind is float and isinstance(value, (int, float)):
        # comparing is safe where converting a whole number of many digits is not
        return float(value) if abs(value) <= sys.float_info.max else _NO
    return value if kind in (int, str) and isinstance(value, kind) else _NO


def describe_type(kind: Any) -> str:
    """Say in words what a field takes."""
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return "one of " + ", ".join(repr(m.value) for m in kind)
    if get_origin(kind) is tuple:
        return "a list of " + " and ".join(describe_type(p) for p in get_args(kind) if p is not Ellipsis)
    return {float: "a finite number", int: "a whole number", str: "a string", bool: "true or false"}.get(
        kind, "a table"
    )


def config_to_mapping(config: Any) -> dict[str, Any]:
    """Return the resolved configuration as plain tables for JSON and TOML (None left out)."""
    values = {item.name: getattr(config, item.name) for item in dataclasses.fields(config)}
    return {name: _plain(value) for name, value in values.items() if value is not None}


def _plain(value: Any) -> Any:
    """Return one value as TOML and JSON have it."""
    if dataclasses.is_dataclass(value):
        return config_to_mapping(value)
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    return value.value if isinstance(value, StrEnum) else value


def config_to_toml(table: Mapping[str, Any], path: str = "") -> str:
    """Return tables of plain values as TOML: first a table's own values, then the tables inside it."""
    lines = [f"{key} = {_toml_value(value)}" for key, value in table.items() if not isinstance(value, Mapping)]
    blocks = ["\n".join(([f"[{path}]"] if path else []) + lines)] if lines else []
    for key, value in table.items():
        if isinstance(value, Mapping):
            blocks.append(config_to_toml(value, f"{path}.{key}" if path else key))
    return "\n\n".join(block for block in blocks if block)


def _toml_value(value: Any) -> str:
    """Write one value; configuration has only numbers, flags, words and lists of them."""
    if isinstance(value, list):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return json.dumps(value) if isinstance(value, str) else repr(value)
