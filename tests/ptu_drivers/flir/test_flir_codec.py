"""FLIR's lines: the manuals' examples whole, byte by byte and with trailing bytes; round trips; anything at all."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptu_drivers import ProtocolError
from ptu_drivers.flir.codec import (
    LONGEST_LINE,
    FlirReply,
    LineSplitter,
    RawLine,
    Stray,
    encode,
    integer,
    integers,
    only_number,
    parse_line,
)

pytestmark = pytest.mark.filterwarnings("error")

# line, echo, ok, text, limit messages
EXAMPLES = [
    (b"PP * Current Pan position is 0", "PP", True, "Current Pan position is 0", 0),
    (b"PP-2500 *", "PP-2500", True, "", 0),
    (b"pR * 92.5714 seconds arc per position", "pR", True, "92.5714 seconds arc per position", 0),
    (b"PN * Minimum Pan position is -3090", "PN", True, "Minimum Pan position is -3090", 0),
    (b"PP3500 ! Maximum allowable Pan position is 3090", "PP3500", False, "Maximum allowable Pan position is 3090", 0),
    (
        b"PS9 ! Motor speed cannot be less than 31 pos/sec",
        "PS9",
        False,
        "Motor speed cannot be less than 31 pos/sec",
        0,
    ),
    (
        b"L * Limit bounds are ENABLED (soft limits enabled)",
        "L",
        True,
        "Limit bounds are ENABLED (soft limits enabled)",
        0,
    ),
    (b"O * Input 30 VDC @ 86 degF", "O", True, "Input 30 VDC @ 86 degF", 0),
    (b"* 0", "", True, "0", 0),
    (b"*", "", True, "", 0),
    (b"! Illegal Command Entered", "", False, "Illegal Command Entered", 0),
    (b"R !T!T!P!P*", "R", True, "", 4),
    (b"!P* 12", "", True, "12", 1),
    (b"PP !P * 12", "PP", True, "12", 1),
    (b"!PPP * 12", "PP", True, "12", 1),
    (b"!T#P$T!D TP * -4", "TP", True, "-4", 4),
    (b"B0,10,500,500 *", "B0,10,500,500", True, "", 0),
    (b"@(115200,0,F) *", "@(115200,0,F)", True, "", 0),
]


def split(data: bytes, pieces: int = 1) -> list[bytes]:
    splitter = LineSplitter()
    lines: list[RawLine] = []
    for k in range(0, len(data), pieces):
        lines += splitter.feed(data[k : k + pieces], float(k), 0.001)
    return [line.data for line in lines]


@pytest.mark.parametrize(("line", "echo", "ok", "text", "events"), EXAMPLES)
@pytest.mark.parametrize("end", [b"\r\n", b"\r", b"\n", b"\r\n\n"])
def test_examples(line: bytes, echo: str, ok: bool, text: str, events: int, end: bytes) -> None:
    for lead in (b"", b"\n", b"\r\n"):
        whole = lead + line + end
        assert split(whole, len(whole)) == split(whole) == [line]
        assert split(whole + b"PP * 1") == [line]
    parsed = parse_line(line)
    assert isinstance(parsed, FlirReply)
    assert (parsed.echo, parsed.ok, parsed.text, parsed.events) == (echo, ok, text, events)
    assert line[parsed.mark_at : parsed.mark_at + 1] == (b"*" if ok else b"!")
    assert line[: max(parsed.delimiter_at, 0)].endswith(echo.encode())
    assert (parsed.delimiter_at < 0) == (echo == "")


def test_without_its_end_text_is_not_a_line() -> None:
    for line, *_ in EXAMPLES:
        splitter = LineSplitter()
        assert splitter.feed(line, 0.0, 0.0) == []
        assert splitter.unfinished == line


def test_times_of_the_bytes() -> None:
    splitter = LineSplitter()
    assert splitter.feed(b"PP ", 10.0, 0.001) == []
    (line,) = splitter.feed(b"* 5\r", 10.02, 0.001)
    assert line.times_s == pytest.approx((9.998, 9.999, 10.0, 10.017, 10.018, 10.019))


@pytest.mark.parametrize("text", [b"PAN-TILT controller ready", b"TILT", b"", b"  ", b"joystick"])
def test_lines_that_are_not_replies(text: bytes) -> None:
    parsed = parse_line(text)
    assert parsed == Stray(text=text.decode(), events=0)


@pytest.mark.parametrize(("text", "events"), [(b"!P", 1), (b"!T!T !P", 3), (b"#P", 1)])
def test_limit_messages_alone(text: bytes, events: int) -> None:
    assert parse_line(text) == Stray(text=text.decode(), events=events)


@pytest.mark.parametrize("line", [b"PP * 12TP * 34", b"PP * 12!P34", b"PP *\x0012", b"\xff\xfe", b"A" * LONGEST_LINE])
def test_merged_and_garbled_lines_are_refused(line: bytes) -> None:
    with pytest.raises(ProtocolError):
        parse_line(line)


def test_an_endless_line_is_cut() -> None:
    assert max(len(line) for line in split(b"x" * 1000)) == LONGEST_LINE


@pytest.mark.parametrize("text", ["", "12.5", "12 13", "1e3", "Current Pan position is 3", "0x12", "١٢", "-", "1 2"])
def test_no_integer(text: str) -> None:
    with pytest.raises(ProtocolError):
        integer(text)


def test_numbers() -> None:
    assert integer("-2500") == -2500
    assert only_number("92.5714 seconds arc per position") == 92.5714
    assert only_number("Maximum Pan speed is 1985 positions/sec") == 1985
    assert integers("1,-2,3,4", 4) == (1, -2, 3, 4)
    assert integers("P(1,-2) S(3,4) T 5", 4) == (1, -2, 3, 4, 5)
    for text in ("1,2,3", "1,2,3,4.5", "1,2,x?,4"):
        with pytest.raises(ProtocolError):
            integers(text, 4)
    for text in ("none", "1 and 2"):
        with pytest.raises(ProtocolError):
            only_number(text)


@pytest.mark.parametrize("command", ["", "PP 5", "PP5*", "PP\r", "P\u00e9", "PP5.5", "12", "@(9600)"])
def test_no_command(command: str) -> None:
    with pytest.raises(ProtocolError):
        encode(command)


@given(
    echo=st.from_regex(r"[A-Za-z]{1,3}(-?[0-9]{1,5})?", fullmatch=True),
    ok=st.booleans(),
    value=st.integers(-99999, 99999),
    events=st.lists(st.sampled_from(["!P", "!T", "#P"]), max_size=3),
    cut=st.integers(1, 9),
)
def test_round_trip(echo: str, ok: bool, value: int, events: list[str], cut: int) -> None:
    line = f"{encode(echo).decode()}{''.join(events)}{'*' if ok else '!'} {value}".encode()
    assert split(b"\n" + line + b"\r\n", cut) == [line]
    parsed = parse_line(line)
    assert isinstance(parsed, FlirReply)
    assert (parsed.echo, parsed.ok, parsed.events) == (echo, ok, len(events))
    assert integer(parsed.text) == value


@given(data=st.binary(max_size=400), cut=st.integers(1, 40))
def test_anything_at_all(data: bytes, cut: int) -> None:
    """Nothing but our own error, whatever comes, and the same lines however it is cut."""
    lines = split(data, cut)
    assert lines == split(data)
    reported = []
    for line in lines:
        try:
            parsed = parse_line(line)
            if isinstance(parsed, FlirReply):
                integer(parsed.text)
        except ProtocolError as fault:
            reported.append(str(fault))
    assert all(text.isprintable() for text in reported)


def test_fuzz_short() -> None:
    """The first of what `benchmarks/ptu_fuzz.py` does a million times."""
    import ptu_fuzz

    ptu_fuzz.fuzz(20_000, random.Random(5))
