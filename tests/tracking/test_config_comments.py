"""The printed tuning: it reads back as it is, each key has its meaning and its bounds, and the bounds are true."""

import tomllib
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path

import pytest

from groundstation.errors import ConfigError
from groundstation.tracking.config import Config, config_from_mapping, config_to_mapping, load_config
from groundstation.tracking.config_comments import commented_toml, meanings_of, unit_of


def all_tables(config: object) -> list[object]:
    inner = [getattr(config, item.name) for item in fields(config)]  # type: ignore[arg-type]
    return [config, *(table for value in inner if is_dataclass(value) for table in all_tables(value))]


@cache
def printed() -> str:
    """Return the whole tuning as it is printed: each bound is searched for, which takes two seconds of a core."""
    return commented_toml(Config())


def test_it_reads_back_as_the_same_tuning() -> None:
    text = printed()
    assert config_from_mapping(Config, tomllib.loads(text), "tuning") == Config()
    assert all(len(line) <= 130 for line in text.splitlines())


def test_each_key_has_a_meaning() -> None:
    for table in all_tables(Config()):
        meanings = meanings_of(type(table))
        keys = [item.name for item in fields(table) if not is_dataclass(getattr(table, item.name))]  # type: ignore[arg-type]
        assert [key for key in keys if not meanings.get(key)] == [], type(table)


def test_each_key_stands_below_a_comment() -> None:
    before = ""
    for line in printed().splitlines():
        if " = " in line and not line.startswith("#"):
            assert before.startswith("#"), line
        before = line


@dataclass(frozen=True, kw_only=True)
class Inner:
    """A table.

    Attributes
    ----------
    share : of something ...
    length_m, width_m : its two
        sizes.
    """

    share: float = 0.25
    length_m: float = 2.0
    width_m: float = 3.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.share < 1.0 or self.length_m <= 0.0:
            raise ValueError("out of bounds")


@dataclass(frozen=True, kw_only=True)
class Outer:
    """A tuning.

    Attributes
    ----------
    count : a number.
    """

    count: int = 5
    inner: Inner = field(default_factory=Inner)

    def __post_init__(self) -> None:
        if not 2 <= self.count <= 40:
            raise ValueError("out of bounds")


def test_bounds_and_units_are_stated() -> None:
    expected = """
# a number; at least 2 and at most 40
count = 5

[inner]
# of something; at least 0 and below 1
share = 0.25
# its two sizes; in m; above 0
length_m = 2.0
# its two sizes; in m
width_m = 3.0
"""
    assert commented_toml(Outer()) == expected.strip()


@pytest.mark.parametrize(
    ("table", "key", "good", "bad"),
    [("detection", "ambiguity_ratio", 1.0, 0.0), ("synchronise", "max_gap_s", 1e-6, 0.0)],
)
def test_stated_bounds_are_those_of_the_tuning(table: str, key: str, good: float, bad: float) -> None:
    values = config_to_mapping(Config())
    config_from_mapping(Config, {**values, table: {**values[table], key: good}}, "tuning")
    with pytest.raises(ConfigError):
        config_from_mapping(Config, {**values, table: {**values[table], key: bad}}, "tuning")


@pytest.mark.parametrize(("name", "unit"), [("lost_sigma_m", "in m"), ("max_rate_deg_s", "in deg/s"), ("levels", "")])
def test_units_follow_the_names(name: str, unit: str) -> None:
    assert unit_of(name) == unit


# a coordinate, a logarithm and a balloon force, whose sign is free
UNBOUNDED = {"min_height_m", "unlikely_odds", "nu"}


def test_every_number_has_a_bound() -> None:
    """Expected: what a key may not be is refused, so that the comment above it says so."""
    comment, without = "", set()
    for line in printed().splitlines():
        key, equals, value = line.partition(" = ")
        if line.startswith("#"):
            comment += line
            continue
        is_number = equals and isinstance(tomllib.loads(f"value = {value}")["value"], int | float)
        if (
            is_number
            and value not in ("true", "false")
            and not any(w in comment for w in ("at least", "above", "at most"))
        ):
            without.add(key)
        comment = ""
    assert without <= UNBOUNDED


@pytest.mark.parametrize(
    "line",
    [
        "[evaluation]\nhuber_sigma = -2",
        "[evaluation]\nprior_position_sigma_m = -1",
        "[detection]\nmin_span_px = -5",
        "[detection]\nappearance_gate = -1.5",
        "[detection]\nmin_contrast_to_noise = -3",
        "[initiation]\nstart_share = -4",
        "[acquisition]\njoin_reach = -1",
    ],
)
def test_a_number_without_a_meaning_is_refused(line: str, tmp_path: Path) -> None:
    path = tmp_path / "tuning.toml"
    path.write_text(line + "\n")
    with pytest.raises(ConfigError, match=line.partition("\n")[2].split()[0]):
        load_config(path)
