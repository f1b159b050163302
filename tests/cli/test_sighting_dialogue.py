"""What a typed line of `groundstation calibrate sightings` asks for."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.cli.sighting_dialogue import HELP, Line, Verb, parse_line
from groundstation.errors import InputError


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", Line(verb=Verb.NOTHING)),
        ("go", Line(verb=Verb.GO)),
        (" 12.5 -3 ", Line(verb=Verb.TURN, numbers=(12.5, -3.0))),
        ("12.5,-3", Line(verb=Verb.TURN, numbers=(12.5, -3.0))),
        ("by -0.1 +0.2", Line(verb=Verb.BY, numbers=(-0.1, 0.2))),
        ("AT 641.5 478", Line(verb=Verb.AT, numbers=(641.5, 478.0))),
        ("look", Line(verb=Verb.LOOK)),
        ("look 3 4", Line(verb=Verb.LOOK, numbers=(3.0, 4.0))),
        ("next church tower", Line(verb=Verb.NEXT, name="church tower")),
        ("quit", Line(verb=Verb.END)),
        # up, up, right: pan is positive to the left
        ("\x1b[A\x1bOA\x1b[C", Line(verb=Verb.ARROWS, numbers=(-1.0, 2.0))),
    ],
)
def test_lines(text: str, line: Line) -> None:
    assert parse_line(text) == line


@pytest.mark.parametrize(
    "text", ["at", "at 1", "by 1 2 3", "left", "1 nan", "1 inf", "1 1e9", "go 1", "\x1b[A2", "step"]
)
def test_other_lines_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="wanted"):
        parse_line(text)


@given(st.text(max_size=40) | st.text("\x1b[OABCD 0.-+eatgolook", max_size=40))
def test_any_text_is_a_line_or_refused(text: str) -> None:
    """Expected: nothing typed ends the dialogue by another error, and numbers stay within bounds."""
    try:
        line = parse_line(text)
    except InputError:
        return
    assert all(abs(v) <= 1e6 for v in line.numbers)


def test_the_help_has_every_word() -> None:
    for verb in set(Verb) - {Verb.TURN, Verb.ARROWS, Verb.HELP, Verb.NOTHING}:
        assert f"\n  {verb}" in f"\n{HELP}"
