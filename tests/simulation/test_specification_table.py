"""Specifications to TOML and back: nothing is lost, and a wrong key or value is named with its place."""

import math
import tomllib
from dataclasses import dataclass
from enum import StrEnum

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.errors import ConfigError
from groundstation.files.toml_table import TomlTable
from groundstation.simulation.parameter_checks import require_positive
from groundstation.simulation.specification_table import read_specification, rounded, specification_table, toml_text


class Kind(StrEnum):
    ROUND = "round"
    FLAT = "flat"


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    size_m: float
    turn_rad: float = 0.0

    def __post_init__(self) -> None:
        require_positive("Part: size_m", self.size_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole:
    name: str
    kind: Kind
    count: int = 3
    lit: bool = False
    limit_rad: float | None = None
    colour_bgr: tuple[float, float, float] = (1.0, 2.0, 3.0)
    turns_rad: tuple[float, ...] = ()
    best: Part
    parts: tuple[Part, ...] = ()


finite = st.floats(-1e6, 1e6)
parts = st.builds(Part, size_m=st.floats(1e-6, 1e6), turn_rad=finite)
wholes = st.builds(
    Whole,
    name=st.text(),
    kind=st.sampled_from(Kind),
    count=st.integers(-(2**63), 2**63 - 1),
    lit=st.booleans(),
    limit_rad=st.none() | finite,
    colour_bgr=st.tuples(finite, finite, finite),
    turns_rad=st.lists(finite, max_size=4).map(tuple),
    best=parts,
    parts=st.lists(parts, max_size=3).map(tuple),
)


def reread(whole: Whole) -> Whole:
    text = toml_text(specification_table(whole))
    return read_specification(Whole, TomlTable(tomllib.loads(text), "world.toml", ConfigError))


@given(wholes)
def test_a_rounded_specification_survives_its_file_to_the_last_bit(whole: Whole) -> None:
    drawn = rounded(whole)
    assert reread(drawn) == drawn
    assert toml_text(specification_table(reread(drawn))) == toml_text(specification_table(drawn))


@given(wholes)
def test_rounding_keeps_six_digits(whole: Whole) -> None:
    drawn = rounded(whole)
    assert drawn.best.size_m == pytest.approx(whole.best.size_m, rel=5e-6)
    assert drawn.best.turn_rad == pytest.approx(whole.best.turn_rad, rel=5.1e-6, abs=1e-300)
    assert (drawn.name, drawn.kind, drawn.count, drawn.lit) == (whole.name, whole.kind, whole.count, whole.lit)


def test_angles_stand_in_degrees_and_none_is_absent() -> None:
    whole = Whole(name="a", kind=Kind.FLAT, best=Part(size_m=1.0, turn_rad=math.radians(30.0)), turns_rad=(math.pi,))
    table = specification_table(whole)
    assert table["best"] == {"size_m": 1.0, "turn_deg": 30.0}
    assert table["turns_deg"] == [180.0]
    assert {"limit_deg", "limit_rad"}.isdisjoint(table)


def table_with(**changes: object) -> TomlTable:
    values = {"name": "a", "kind": "flat", "best": {"size_m": 1.0}, **changes}
    return TomlTable(values, "world.toml", ConfigError)


@pytest.mark.parametrize(
    ("changes", "where", "wanted"),
    [
        ({"colour": 1}, "world.toml: colour", "one of "),
        ({"kind": "square"}, "world.toml: kind", "'round', 'flat'"),
        ({"count": 2.5}, "world.toml: count", "a whole number"),
        ({"count": True}, "world.toml: count", "a whole number"),
        ({"lit": 1}, "world.toml: lit", "true or false"),
        ({"limit_deg": "wide"}, "world.toml: limit_deg", "a finite number"),
        ({"limit_deg": math.inf}, "world.toml: limit_deg", "a finite number"),
        ({"colour_bgr": [1.0, 2.0]}, "world.toml: colour_bgr", "a list of 3 values"),
        ({"turns_deg": [1.0, "b"]}, "world.toml: turns_deg[2]", "a finite number"),
        ({"best": 3}, "world.toml: best", "a table"),
        ({"best": {}}, "world.toml: best: size_m", "a finite number"),
        ({"best": {"size_m": -1.0}}, "world.toml: best: Part: size_m", "> 0"),
        ({"parts": [{"size_m": 1.0}, {"size_m": 0.0}]}, "world.toml: parts[2]: Part: size_m", "> 0"),
    ],
)
def test_a_wrong_value_is_named_with_its_place(changes: dict[str, object], where: str, wanted: str) -> None:
    with pytest.raises(ConfigError) as fault:
        read_specification(Whole, table_with(**changes))
    assert fault.value.where == where
    assert wanted in fault.value.wanted


def test_defaults_fill_absent_keys() -> None:
    whole = read_specification(Whole, table_with())
    assert whole == Whole(name="a", kind=Kind.FLAT, best=Part(size_m=1.0))
