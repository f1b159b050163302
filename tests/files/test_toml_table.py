from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.errors import ConfigError, RigError
from groundstation.files.toml_table import MAX_TOML_BYTES, TomlTable, load_toml, quoted, shown
from tests.complaints import only
from tests.mutation import toml_values


def table(**values: Any) -> TomlTable:
    return TomlTable(values, "rig.toml", RigError)


def test_values_are_read_with_their_type() -> None:
    t = table(name="left", x=3, flag=True, v=[1, 2.5], sub={"y": 1})
    assert (t.text("name"), t.number("x"), t.flag("flag", False), t.table("sub").number("y")) == ("left", 3.0, True, 1)
    assert t.vector("v", 2).dtype == np.float64
    assert "x" in t
    assert "z" not in t


def test_defaults_replace_absent_keys() -> None:
    t = table()
    assert (t.text("a", "b"), t.number("x", 2.0), t.flag("f", True)) == ("b", 2.0, True)
    assert t.vector("v", 2, (1.0, 2.0)).tolist() == [1.0, 2.0]
    assert not t.table("sub").values


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        (True, "≥ 0"),
        ("1", "≥ 0"),
        (float("nan"), "≥ 0"),
        (float("inf"), "≥ 0"),
        (10**400, "≥ 0"),
        (-1, "≥ 0"),
        ([1], "≥ 0"),
    ],
)
def test_a_number_that_is_none(value: object, wanted: str) -> None:
    with pytest.raises(RigError, match=f"rig.toml: x: got .*wanted a finite number {wanted}"):
        table(x=value).number("x", minimum=0.0)


def test_bounds_that_belong_and_do_not_belong() -> None:
    assert table(x=0).number("x", minimum=0.0) == 0.0
    with pytest.raises(RigError, match="got 0; wanted a finite number > 0"):
        table(x=0).number("x", above=0.0)


@pytest.mark.parametrize("value", [[1], [1, 2, 3], [1, "2"], [1, True], [1, float("nan")], [1, 10**400], 1, {"a": 1}])
def test_a_vector_that_is_none(value: object) -> None:
    with pytest.raises(RigError, match=r"rig.toml: v: got .*wanted 2 finite numbers"):
        table(v=value).vector("v", 2)


def test_other_types_are_refused_by_name() -> None:
    with pytest.raises(RigError, match="a: got 1; wanted a string"):
        table(a=1).text("a")
    with pytest.raises(RigError, match="f: got 1; wanted true or false"):
        table(f=1).flag("f", False)
    with pytest.raises(RigError, match=r"rig.toml: s: got 3; wanted a table"):
        table(s=3).table("s")
    with pytest.raises(RigError, match=r"rig.toml: a: got nothing; wanted a string"):
        table().text("a")
    with pytest.raises(RigError, match=r"rig.toml: nmae: got an unknown key; wanted one of fixed, name"):
        table(nmae="left").refuse_unknown({"name", "fixed"})


def test_faults_of_the_file_itself(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    with pytest.raises(ConfigError, match=r"c.toml: got no such file; wanted a TOML file"):
        load_toml(path, ConfigError)
    with pytest.raises(ConfigError, match=r"got a folder; wanted a TOML file"):
        load_toml(tmp_path, ConfigError)
    path.write_text("a = 1\nb = \n")
    with pytest.raises(ConfigError, match=r"got not TOML \(Invalid value \(at line 2, column 5\)\)"):
        load_toml(path, ConfigError)
    path.write_bytes(b"a = '\xff'")
    with pytest.raises(ConfigError, match=r"got not TOML \(no text: byte 0xff in place \d+\); wanted a TOML file"):
        load_toml(path, ConfigError)
    path.write_text("a = " + "9" * 5000)
    with pytest.raises(ConfigError, match="got not TOML"):
        load_toml(path, ConfigError)
    path.write_text("#" * (MAX_TOML_BYTES + 1))
    with pytest.raises(ConfigError, match="wanted at most 4000000 bytes"):
        load_toml(path, ConfigError)


def test_utf_16_is_named(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_bytes("a = 1\n".encode("utf-16"))
    with pytest.raises(ConfigError, match="got text in UTF-16; wanted a TOML file in UTF-8"):
        load_toml(path, ConfigError)


def test_a_byte_order_mark_is_no_fault(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_bytes("\ufeffa = 1".encode())
    assert load_toml(tmp_path / "c.toml", ConfigError) == {"a": 1}


def test_what_is_shown_fits_into_one_line() -> None:
    assert shown("a\nb\x1b[31m") == "a\\nb\\x1b[31m"
    assert shown("x" * 100) == "x" * 59 + "…"
    assert quoted("it") == "'it'"
    assert quoted(16**5000) == "a whole number of thousands of digits"


@given(toml_values(), st.text(max_size=5))
def test_any_value_gives_a_result_or_one_printable_line(value: Any, key: str) -> None:
    t = TomlTable({key: value}, "f.toml", RigError)
    for read in (
        lambda: t.number(key, minimum=0.0),
        lambda: t.vector(key, 3),
        lambda: t.text(key),
        lambda: t.flag(key, True),
        lambda: t.table(key).refuse_unknown({"a"}),
        lambda: t.refuse_unknown({"a"}),
    ):
        with only(RigError):
            read()


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("a.b.c.d.e.f.g.h = 1", True),
        (".".join("abcdefghijklmnop") + " = 1", True),
        (".".join("abcdefghijklmnopq") + " = 1", False),
        ("[" + ".".join("abcdefghijklmnopq") + "]", False),
        (" . ".join("abcdefghijklmnopq") + " = 1", False),
        (".".join('"x.y"' for _ in range(9)) + " = 1", True),
        (".".join(f'"{c}"' for c in "abcdefghijklmnopq") + " = 1", False),
        ("a = { " + ".".join("abcdefghijklmnopq") + " = 1 }", False),
        ("a = [" + ", ".join(["1.5"] * 400) + "]", True),
        ('a = "' + "." * 100 + '" # ' + "." * 100, True),
        ("a = '" + "." * 100 + "'\nb = 1.5", True),
        ('a = """\n' + "x.\n" * 100 + '"..""." \\""" ""."""', True),
        ("a = '''\n" + "x.\n" * 100 + "'.''.'''", True),
        ('a = "\\"' + "." * 30 + '"', True),
    ],
)
def test_keys_of_many_parts_are_refused_and_dots_elsewhere_are_not(text: str, read: bool, tmp_path: Path) -> None:
    """Expected: 16 parts, however they are written; points in texts, remarks and numbers are no parts."""
    path = tmp_path / "x.toml"
    path.write_text(text + "\n", encoding="utf-8")
    if read:
        load_toml(path, ConfigError)
    else:
        with pytest.raises(ConfigError, match="a key of 17 parts; wanted keys of at most 16"):
            load_toml(path, ConfigError)


@pytest.mark.parametrize("number", [f"0x{'f' * 4000}", "9223372036854775808", "-9223372036854775809"])
def test_integers_beyond_64_bits_are_refused(tmp_path: Path, number: str) -> None:
    """Expected: an error of one line; a number of thousands of digits cannot even be printed."""
    path = tmp_path / "session.toml"
    path.write_text(f"[dgps]\ndate = [1, {number}]\n")
    with pytest.raises(ConfigError, match=r"not TOML \(an integer of \d+ bits\)"):
        load_toml(path, ConfigError)
    path.write_text("first = -9223372036854775808\nlast = 9223372036854775807\n")
    assert load_toml(path, ConfigError) == {"first": -(2**63), "last": 2**63 - 1}
