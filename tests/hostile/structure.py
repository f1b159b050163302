"""A recording taken apart into its records, changed and put together again under right or wrong checksums."""

import json
import random
import struct
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode

from groundstation.messages import Event, Frame, PixelMeasurement
from groundstation.recording.mcap_reader import MAGIC
from groundstation.recording.recorder import PATIENT, Recorder
from tests.hostile.records import Record, attachment, container, metadata, record, text
from tests.recording.recorded import events, header, looked_at, small_rig
from tests.session.logs.damage import altered, damaged

_HEAD = struct.Struct("<BQ")
_NAMES = (
    *(
        "../../planted",
        "/tmp/planted",
        "..",
        ".",
        "",
        "a/b",
        "left",
        "left.mp4",
        "frames.csv",
        "ptu.csv",
        "SESSION.TOML",
    ),
    *("session.toml", "rig.toml", "config.toml", "dgps.csv", "truth.csv", "detections.csv", "con", "x" * 300, "a\0b"),
    *("masks.npz", "\x1b[2J", "left/000000.png", "C:\\planted", "~/planted", "dgps.nmea", "session.rrd", "é" * 130),
)
_WORDS = (
    *("left", "right", "../../left", "/tmp/left", "", "third", "left\n", "0", "-1", "1e12", "NaN", "null", "[]", "{}"),
    *(
        "9007199254740993",
        "true",
        "track",
        "epoch",
        "frame",
        "ptu",
        "pixel",
        "reference",
        "begun anew",
        "lost",
        "dropped",
    ),
)
_LENGTHS = (0, 1, 2**16, 2**31, 2**32, 2**62, 2**63, 2**64 - 1)


def small_recordings(folder: Path) -> list[Path]:
    """Write a recording with pictures of a few pairs, and one of pixels alone; returns their paths."""
    paths = [folder / "pictures.mcap", folder / "pixels.mcap"]
    config = type(PATIENT)(patient=True, chunk_bytes=4096, chunk_s=1e9)
    for number, path in enumerate(paths):
        head = replace(header(), pictures=not number)
        with Recorder(path, small_rig(), head, config, free_bytes=lambda: 10**12) as recorder:
            given = events(3, np.random.default_rng(number))
            for event in recorder.taken(map(_pixel, given) if number else given):
                recorder.write(looked_at(event))
    return paths


def _pixel(event: Event) -> Event:
    """Return pixels detected elsewhere, in place of a frame."""
    if not isinstance(event, Frame):
        return event
    return PixelMeasurement(t_s=event.t_s, station=event.station, epoch=event.epoch, u_px=31.0, v_px=23.5)


def records_of(data: bytes) -> list[Record]:
    """Return the records of a whole file, or of what a chunk holds, up to the footer."""
    found: list[Record] = []
    at = len(MAGIC) if data.startswith(MAGIC) else 0
    while at + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if opcode == Opcode.DATA_END:
            break
        found.append((opcode, data[at : at + length]))
        at += length
    return found


class Structure:
    """One whole recording, to be written again otherwise."""

    def __init__(self, path: Path) -> None:
        self._records = records_of(path.read_bytes())

    def mutated(self, chance: random.Random) -> bytes:
        """Return the recording with one to four changes."""
        records = list(self._records)
        closed = chance.random() < 0.9
        for _ in range(chance.choice((1, 1, 1, 2, 3))):
            records = chance.choice(_CHANGES)(records, chance)
        data = container(records, closed=closed)
        if chance.random() < 0.1:
            data = _with_length(data, chance)
        return data[: chance.randrange(len(data))] if chance.random() < 0.05 else data


def _with_length(data: bytes, chance: random.Random) -> bytes:
    """Return the file with the length of one of its records changed."""
    at, places = len(MAGIC), []
    while at + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        places.append(at)
        at += _HEAD.size + length
        if opcode == Opcode.DATA_END:
            break
    at = chance.choice(places)
    opcode, length = _HEAD.unpack_from(data, at)
    other = chance.choice((*_LENGTHS, length + 1, max(length - 1, 0)))
    return data[:at] + _HEAD.pack(opcode, other) + data[at + _HEAD.size :]


Change = Callable[[list[Record], random.Random], list[Record]]


def _order(records: list[Record], chance: random.Random) -> list[Record]:
    """Let records change places, come again, or be gone; or be of another kind."""
    records = list(records)
    if not records:
        return records
    one, other = chance.randrange(len(records)), chance.randrange(len(records))
    kind = chance.randrange(4)
    if kind == 0:
        records[one], records[other] = records[other], records[one]
    elif kind == 1:
        records[one:one] = [records[other]] * chance.choice((1, 1, 2, 50))
    elif kind == 2:
        del records[one]
    else:
        records[one] = (chance.choice((*range(16), 0x80, 0xFF)), records[one][1])
    return records


def _attached(records: list[Record], chance: random.Random) -> list[Record]:
    """Attach a file of a name that may lead elsewhere."""
    added = attachment(chance.choice(_NAMES), chance.choice((b"planted", b"", b"t_s,x_m,y_m,z_m\n1,2,3,4\n")))
    return [*records[:2], added, *records[2:]]


def _renamed(records: list[Record], chance: random.Random) -> list[Record]:
    """Give an attached file or a note another name."""
    places = [k for k, (opcode, _) in enumerate(records) if opcode in (Opcode.ATTACHMENT, Opcode.METADATA)]
    if not places:
        return records
    k = chance.choice(places)
    opcode, content = records[k]
    name_at = 16 if opcode == Opcode.ATTACHMENT else 0
    if len(content) < name_at + 4:
        return records
    (length,) = struct.unpack_from("<I", content, name_at)
    renamed = content[:name_at] + text(chance.choice(_NAMES)) + content[name_at + 4 + length :]
    return [*records[:k], (opcode, renamed), *records[k + 1 :]]


def _altered(records: list[Record], chance: random.Random) -> list[Record]:
    """Change what stands in an attached file or a note: its numbers, its names, or any of its bytes."""
    places = [k for k, (opcode, _) in enumerate(records) if opcode in (Opcode.ATTACHMENT, Opcode.METADATA)]
    if not places:
        return records
    k = chance.choice(places)
    opcode, content = records[k]
    return [*records[:k], (opcode, _spoilt(content, chance)), *records[k + 1 :]]


def _spoilt(content: bytes, chance: random.Random) -> bytes:
    kind = chance.randrange(3)
    if kind == 0:
        return altered(content, chance)
    if kind == 1:
        return damaged(content, chance)
    # of the same length, so that what is around it stays whole
    old = chance.choice((b"left", b"right", b"true", b"false", b"tiny"))
    new = chance.choice((b"../x", b"/tmp/", b"con\0", b"null ", b"LEFT ", b"\xff\xff\xff\xff\xff"))[: len(old)]
    return content.replace(old, new.ljust(len(old), b"_"), chance.choice((1, -1)))


def _noted(records: list[Record], chance: random.Random) -> list[Record]:
    """Put in a note of the header's name, or of the end's, with other values."""
    values = {
        "format": "groundstation-recording/1",
        chance.choice(("name", "pictures", "initial", "left_out", "taught")): (chance.choice(_WORDS)),
        "events": chance.choice(_WORDS),
        "epochs": chance.choice(_WORDS),
        "first_s": "0",
        "last_s": chance.choice(_WORDS),
    }
    added = metadata(chance.choice(("groundstation", "groundstation.end")), values)
    at = chance.choice((0, len(records)))
    return [*records[:at], added, *records[at:]]


def _inside(records: list[Record], chance: random.Random) -> list[Record]:
    """Change what a chunk holds: its records' order and kinds, messages, numbers of channels; and how it is packed."""
    places = [k for k, (opcode, _) in enumerate(records) if opcode == Opcode.CHUNK]
    if not places:
        return records
    k = chance.choice(places)
    content = records[k][1]
    try:
        inner = records_of(_unpacked(content))
    except (struct.error, RuntimeError, ValueError, zstandard.ZstdError):
        return records
    for _ in range(chance.randint(1, 3)):
        inner = _order(inner, chance) if chance.random() < 0.3 else _message_changed(inner, chance)
    changed = _chunk(b"".join(record(*one) for one in inner), chance)
    return [*records[:k], (Opcode.CHUNK, changed), *records[k + 1 :]]


def _message_changed(inner: list[Record], chance: random.Random) -> list[Record]:
    places = [k for k, (opcode, _) in enumerate(inner) if opcode in (Opcode.MESSAGE, Opcode.CHANNEL, Opcode.SCHEMA)]
    if not places:
        return inner
    k = chance.choice(places)
    opcode, content = inner[k]
    if opcode == Opcode.MESSAGE and content[22:23] == b"{" and chance.random() < 0.7:
        content = content[:22] + _line(content[22:], chance)
    else:
        content = _spoilt(content, chance)
    return [*inner[:k], (opcode, content), *inner[k + 1 :]]


def _line(line: bytes, chance: random.Random) -> bytes:
    """Return a line of JSON with one of its values another."""
    try:
        values = json.loads(line)
    except ValueError:
        return line
    key = chance.choice(list(values))
    word = chance.choice((*_WORDS, *_NAMES))
    try:
        values[key] = json.loads(word)
    except ValueError:
        values[key] = word
    if chance.random() < 0.1:
        values[key] = [values[key]] * chance.choice((3, 100, 10_000))
    return json.dumps(values).encode()


def _unpacked(content: bytes) -> bytes:
    (length,) = struct.unpack_from("<I", content, 28)
    kind = content[32 : 32 + length]
    data = content[32 + length + 8 :]
    if kind == b"lz4":
        unpacked: bytes = lz4.frame.decompress(data)
        return unpacked
    return zstandard.ZstdDecompressor().decompress(data) if kind == b"zstd" else data


def _chunk(inside: bytes, chance: random.Random) -> bytes:
    kind = chance.choice(("", "lz4", "lz4", "zstd", "snappy"))
    packed = {"lz4": lz4.frame.compress, "zstd": zstandard.ZstdCompressor().compress}.get(kind, bytes)(inside)
    sum_ = chance.choice((zlib.crc32(inside), zlib.crc32(inside), 0, 1))
    stated_length = chance.choice((*[len(inside)] * 6, *_LENGTHS))
    head = struct.pack("<QQQI", 0, 0, stated_length, sum_) + text(kind)
    return head + struct.pack("<Q", chance.choice((*[len(packed)] * 8, 0, 2**40))) + packed


_CHANGES: tuple[Change, ...] = (
    _order,
    _attached,
    _renamed,
    _altered,
    _altered,
    _noted,
    _inside,
    _inside,
    _inside,
    _inside,
)
