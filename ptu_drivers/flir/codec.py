"""FLIR / Directed Perception ASCII: bytes to lines, lines to replies; no I/O and no clock.

A command is letters, an optional signed integer and a delimiter (a space here). A line of the unit is
`[echo] [limit messages] (* | !) [text]`, ended by CR, LF or both. Limit messages (`!P`, `!T` and similar) may arrive
at any time and have no line of their own.
"""

import re
from dataclasses import dataclass

from ptu_drivers.errors import ProtocolError

DELIMITER = b" "
LONGEST_LINE = 256

_COMMAND = re.compile(r"[A-Za-z@_]{1,8}(?:-?\d{1,7}|\(\d+,\d+,[TF]\)|-?\d+,-?\d+,\d+,\d+)?", re.ASCII)
_EVENTS = r"(?:(?:![PTD](?![a-z])|[#$][PT])\s*)*"
_LINE = re.compile(
    rf"\s*(?P<before>{_EVENTS})(?P<echo>[^*!]*?)\s*(?P<after>{_EVENTS})(?P<mark>[*!])\s*(?P<text>.*?)\s*"
)
_ONLY_EVENTS = re.compile(r"\s*(?:(?:![PTD]|[#$][PT])\s*)+")
_INTEGER = re.compile(r"[-+]?[0-9]{1,10}")
_NUMBER = re.compile(r"(?<![\w.])[-+]?[0-9]+(?:\.[0-9]+)?(?![\w.]*\d)")


@dataclass(frozen=True, slots=True, kw_only=True)
class RawLine:
    """A line without its end.

    Attributes
    ----------
    data : its bytes, never empty.
    times_s : when each of them had come, s.
    """

    data: bytes
    times_s: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlirReply:
    """A line that is the reply to a command.

    Attributes
    ----------
    echo : the command as the unit repeats it, "" with echo off.
    ok : `*` rather than `!`.
    text : the rest.
    events : limit messages in the line.
    mark_at, delimiter_at : positions in the line of the `*` or `!`, and of the echo's delimiter (-1 without echo).
    """

    echo: str
    ok: bool
    text: str
    events: int
    mark_at: int
    delimiter_at: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Stray:
    """A line that is not a reply: a banner, or limit messages alone.

    Attributes
    ----------
    text : the line. events : limit messages in it; if there are any, the line has no other content.
    """

    text: str
    events: int


class LineSplitter:
    """Received bytes in; whole lines out. An incomplete line stays until `forget`."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._times: list[float] = []

    def feed(self, data: bytes, t_s: float, character_s: float) -> list[RawLine]:
        """Add bytes of which the last had arrived at `t_s`, one each `character_s`; return the lines that ended.

        A line longer than `LONGEST_LINE` is returned as it is: no reply is that long.
        """
        lines = []
        last = len(data) - 1
        for k, byte in enumerate(data):
            if byte in b"\r\n" or len(self._data) >= LONGEST_LINE:
                if self._data:
                    lines.append(RawLine(data=bytes(self._data), times_s=tuple(self._times)))
                    self.forget()
                if byte in b"\r\n":
                    continue
            self._data.append(byte)
            self._times.append(t_s - (last - k) * character_s)
        return lines

    @property
    def unfinished(self) -> bytes:
        """Return the line that has not ended."""
        return bytes(self._data)

    def forget(self) -> None:
        """Drop the line that has not ended."""
        self._data.clear()
        self._times.clear()


def encode(command: str) -> bytes:
    """Return the bytes of one command with its delimiter.

    Raises
    ------
    ProtocolError : not a command of this protocol.
    """
    if not _COMMAND.fullmatch(command):
        raise ProtocolError("command", got=repr(command), wanted="letters and an optional integer")
    return command.encode("ascii") + DELIMITER


def parse_line(data: bytes) -> FlirReply | Stray:
    """Return the parsed content of a line.

    Raises
    ------
    ProtocolError : bytes that no unit sends as text, a line that is too long, or replies without line ends.
    """
    if len(data) >= LONGEST_LINE or any(not 0x20 <= byte < 0x7F and byte != 0x09 for byte in data):
        raise ProtocolError("line", got=repr(data[:40]), wanted="printable text")
    text = data.decode("ascii")
    if _ONLY_EVENTS.fullmatch(text):
        return Stray(text=text.strip(), events=_count(text))
    found = _LINE.fullmatch(text)
    if not found:
        return Stray(text=text, events=0)
    if any(mark in found["text"] for mark in "*!"):
        raise ProtocolError("line", got=repr(text), wanted="one answer, not several merged")
    echo = found["echo"]
    return FlirReply(
        echo=echo,
        ok=found["mark"] == "*",
        text=found["text"],
        events=_count(found["before"]) + _count(found["after"]),
        mark_at=found.start("mark"),
        delimiter_at=found.end("echo") if echo else -1,
    )


def integer(text: str) -> int:
    """Return the number of a terse reply, which must contain nothing else.

    Raises
    ------
    ProtocolError
    """
    if not _INTEGER.fullmatch(text):
        raise ProtocolError("answer", got=repr(text), wanted="one integer")
    return int(text)


def only_number(text: str) -> float:
    """Return the only number in a reply, terse or verbose.

    Raises
    ------
    ProtocolError : none, or several.
    """
    found = _NUMBER.findall(text)
    if len(found) != 1:
        raise ProtocolError("answer", got=repr(text), wanted="one number")
    return float(found[0])


def integers(text: str, least: int) -> tuple[int, ...]:
    """Return the integers of a reply to a combined query, in its order.

    Raises
    ------
    ProtocolError : fewer than `least`, or other text between them.
    """
    parts = [p for p in re.split(r"[\s,;:()A-Za-z]+", text) if p]
    if len(parts) < least or not all(_INTEGER.fullmatch(p) for p in parts):
        raise ProtocolError("answer", got=repr(text), wanted=f"{least} integers or more")
    return tuple(int(p) for p in parts)


def _count(events: str) -> int:
    return sum(events.count(c) for c in "!#$")
