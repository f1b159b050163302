"""A million random byte strings through the FLIR codec: nothing but its own error may come out. `make fuzz`."""

import argparse
import random
from contextlib import suppress

from ptu_drivers import ProtocolError
from ptu_drivers.flir_codec import Answer, LineSplitter, integer, integers, only_number, parse_line

PIECES = (
    b"PP", b"TP", b"pP-12", b" ", b"*", b"!", b"!P", b"!T", b"\r", b"\n", b"\r\n", b"0", b"-2500", b"92.5714", b",",
    b"Current Pan position is ", b"\xff", b"\x00", b"@(9600,0,F)", b"$T", b"#", b"(", b"e", b"+", b".",
)  # fmt: skip


def string(rnd: random.Random) -> bytes:
    """Return a byte string: random, or put together from what units say, or such with bytes changed."""
    kind = rnd.random()
    if kind < 0.25:
        return rnd.randbytes(rnd.randrange(60))
    data = bytearray(b"".join(rnd.choices(PIECES, k=rnd.randrange(1, 16))))
    if kind > 0.6:
        for _ in range(rnd.randrange(1, 4)):
            data[rnd.randrange(len(data))] = rnd.randrange(256)
    return bytes(data)


def fuzz(count: int, rnd: random.Random) -> dict[str, int]:
    """Feed so many byte strings; return how many lines, answers and numbers came of them."""
    found = {"strings": count, "lines": 0, "answers": 0, "numbers": 0, "refused": 0}
    splitter = LineSplitter()
    for _ in range(count):
        for line in splitter.feed(string(rnd), 0.0, 0.001):
            found["lines"] += 1
            try:
                parsed = parse_line(line.data)
            except ProtocolError:
                found["refused"] += 1
                continue
            if isinstance(parsed, Answer):
                found["answers"] += 1
                for read in (integer, only_number, lambda text: integers(text, 4)):
                    with suppress(ProtocolError):
                        read(parsed.text)
                        found["numbers"] += 1
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--strings", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(fuzz(options.strings, random.Random(options.seed)))


if __name__ == "__main__":
    main()
