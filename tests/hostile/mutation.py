"""Structure-aware random mutation of files: lengths, repetition, splices, nesting."""

import random
import struct
from collections.abc import Sequence

from tests.session.logs.damage import altered, damaged, forged

# as long as what is repeated becomes at most
MOST_BYTES = 200_000
_LENGTHS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**62, 2**63, 2**64 - 1)
_WIDTHS = {1: "B", 2: "H", 4: "I", 8: "Q"}
_TEXTS = (
    b"[" * 2000, b"{" * 2000, b"(" * 500, b"a." * 3000 + b"b = 1\n", b"[" + b"a." * 3000 + b"b]\n", b"\n" * 5000,
    b'"' + b"x" * 70_000, b"," * 5000, b"0," * 5000, b"../../x", b"/etc/passwd", b"\\\\host\\x", b"\x00", b"\r", b"nan",
    b"\x1b[2J", b"%s%n", b"9" * 5000, b"1e" + b"9" * 400, b"-0", b"0x" + b"f" * 4000, b"\xef\xbb\xbf", b"\xff\xfe",
    b"\xed\xa0\x80", b"'''", b'"""', "\u202e\u0000".encode(), b"#", b"%", b"$GPGGA,", b"&a [*a,*a]", b"inf",
    b"!!python/object:os.system", b" " * 5000, b"_" * 5000, b"a " * 3000,
)  # fmt: skip


def mutated(name: str, seeds: Sequence[bytes], chance: random.Random) -> bytes:
    """Return one of the whole files of a reader, changed; ``name`` ends as the file's kind does."""
    content = chance.choice(seeds)
    kind = chance.random()
    if kind < 0.2:
        content = forged(name, content, chance)
    elif kind < 0.4:
        content = altered(content, chance)
    if kind > 0.2:
        for _ in range(chance.randint(1, 3)):
            content = _changed(content, seeds, chance)
    return content[: 2 * MOST_BYTES]


def _changed(content: bytes, seeds: Sequence[bytes], chance: random.Random) -> bytes:
    """Return the content with one change."""
    at = chance.randrange(len(content) + 1)
    end = min(len(content), at + chance.choice((1, 4, 16, 64, 256, 4096)))
    kind = chance.randrange(8)
    if kind == 0:
        return _with_length(content, at, chance)
    if kind == 1:
        # a piece again and again: an index, a row, a record
        times = chance.choice((2, 10, 100, 1000, 10_000))
        return content[:end] + content[at:end] * min(times, MOST_BYTES // max(end - at, 1)) + content[end:]
    if kind == 2:
        other = chance.choice(seeds)
        return content[:at] + other[chance.randrange(len(other) + 1) :]
    if kind == 3:
        return content[:at] + chance.choice(_TEXTS) + content[end if chance.random() < 0.5 else at :]
    if kind == 4 and content:
        flipped = bytearray(content)
        for _ in range(chance.choice((1, 1, 2, 8))):
            flipped[chance.randrange(len(flipped))] ^= 1 << chance.randrange(8)
        return bytes(flipped)
    if kind == 5:
        # two pieces change places
        middle = content[at:end]
        rest = content[:at] + content[end:]
        place = chance.randrange(len(rest) + 1)
        return rest[:place] + middle + rest[place:]
    if kind == 6:
        return content[:at]
    return damaged(content, chance)


def _with_length(content: bytes, at: int, chance: random.Random) -> bytes:
    """Return the content with a number of one to eight bytes that may be a length, changed."""
    width = chance.choice((1, 2, 4, 8))
    at = min(at, max(len(content) - width, 0))
    value = chance.choice(_LENGTHS) if chance.random() < 0.7 else chance.getrandbits(8 * width)
    number = struct.pack(chance.choice("<>") + _WIDTHS[width], value & (256**width - 1))
    return content[:at] + number + content[at + width :]
