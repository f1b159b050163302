"""A million random byte strings through each of the FLIR and the Alpaca codec: nothing but our own errors may come out.

Those of Pelco and Dynamixel are in ptu_serial_faults.py. `make fuzz`.
"""

import argparse
import random
from contextlib import suppress

from ptu_drivers import ProtocolError, PtuError
from ptu_drivers.alpaca.codec import angles_of, decode, finite, rates_of
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.flir.codec import FlirReply, LineSplitter, integer, integers, only_number, parse_line

PIECES = (
    b"PP", b"TP", b"pP-12", b" ", b"*", b"!", b"!P", b"!T", b"\r", b"\n", b"\r\n", b"0", b"-2500", b"92.5714", b",",
    b"Current Pan position is ", b"\xff", b"\x00", b"@(9600,0,F)", b"$T", b"#", b"(", b"e", b"+", b".",
)  # fmt: skip


def string(rnd: random.Random) -> bytes:
    """Return a byte string: random, or composed of units' replies, or such with bytes changed."""
    kind = rnd.random()
    if kind < 0.25:
        return rnd.randbytes(rnd.randrange(60))
    data = bytearray(b"".join(rnd.choices(PIECES, k=rnd.randrange(1, 16))))
    if kind > 0.6:
        for _ in range(rnd.randrange(1, 4)):
            data[rnd.randrange(len(data))] = rnd.randrange(256)
    return bytes(data)


def fuzz(count: int, rnd: random.Random) -> dict[str, int]:
    """Feed so many byte strings; return the number of lines, replies and numbers in them."""
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
            if isinstance(parsed, FlirReply):
                found["answers"] += 1
                for read in (integer, only_number, lambda text: integers(text, 4)):
                    with suppress(ProtocolError):
                        read(parsed.text)
                        found["numbers"] += 1
    return found


VALUES = (
    b"0", b"-0.5", b"123.25", b"1e400", b"-1e999", b"1" + b"0" * 400, b"9" * 5000, b"NaN", b"-Infinity", b"null",
    b"true", b'""', b'"Azimuth"', b'"\\ud800"', b"[]", b"{}", b"[[1]]", b"[" * 3000, b'{"Minimum":0.1,"Maximum":4}',
    b'{"Name":"Azimuth","Value":12.5}', b'{"Name":"Altitude","Value":-3}', b'{"Name":["Azimuth"],"Value":{}}',
)  # fmt: skip
KEYS = (b"Value", b"ClientTransactionID", b"ErrorNumber", b"ErrorMessage", b"Name")


def answer(rnd: random.Random) -> bytes:
    """Return a body: random, or a reply of an Alpaca server with odd values, or such with bytes changed."""
    kind = rnd.random()
    if kind < 0.1:
        return rnd.randbytes(rnd.randrange(60))
    items = [rnd.choice(VALUES) for _ in range(rnd.randrange(4))]
    value = b"[" + b",".join(items) + b"]" if rnd.random() < 0.5 else rnd.choice(VALUES)
    pairs = [
        b'"Value":' + value,
        *(b'"%b":%b' % (rnd.choice(KEYS), rnd.choice(VALUES)) for _ in range(rnd.randrange(3))),
    ]
    data = bytearray(b"{" + b",".join(pairs) + b"}")
    if kind > 0.7:
        for _ in range(rnd.randrange(1, 4)):
            data[rnd.randrange(len(data))] = rnd.randrange(256)
    return bytes(data)


def fuzz_alpaca(count: int, rnd: random.Random) -> dict[str, int]:
    """Parse so many bodies as replies; return how many were one, and how many numbers were accepted."""
    found = {"strings": count, "answers": 0, "numbers": 0}
    for _ in range(count):
        try:
            value = decode("azimuth", 200 if rnd.random() < 0.95 else 400, answer(rnd), 0).get("Value")
        except (ExchangeFailed, PtuError):
            continue
        found["answers"] += 1
        for read in (lambda value: finite("azimuth", value), angles_of, rates_of):
            with suppress(ExchangeFailed):
                read(value)
                found["numbers"] += 1
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--strings", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for name, run in (("FLIR", fuzz), ("Alpaca", fuzz_alpaca)):
        print(f"{name}: {run(options.strings, random.Random(options.seed))}", flush=True)


if __name__ == "__main__":
    main()
