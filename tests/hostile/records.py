"""A recording as its records, to be put together again otherwise: other names, lengths, order, checksums."""

import struct
from collections.abc import Iterable, Mapping
from io import BytesIO
from pathlib import Path

from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from groundstation.recording.mcap_metadata import ABOUT
from groundstation.recording.mcap_reader import MAGIC, McapReader

Record = tuple[int, bytes]


def record(opcode: int, content: bytes, length: int | None = None) -> bytes:
    """Return the bytes of one record; its length may be a lie."""
    return struct.pack("<BQ", opcode, len(content) if length is None else length) + content


def container(records: Iterable[Record], *, closed: bool = True) -> bytes:
    """Return the bytes of a file of some records, with the end of a closed one by default."""
    end = record(Opcode.DATA_END, bytes(4)) + record(Opcode.FOOTER, bytes(20)) + MAGIC if closed else b""
    return MAGIC + b"".join(record(*one) for one in records) + end


def text(value: str) -> bytes:
    """Return a string as the container has it."""
    return struct.pack("<I", len(value.encode())) + value.encode()


def chunk(
    inside: bytes, compression: str = "", *, stated_length: int | None = None, packed: bytes | None = None
) -> Record:
    """Return a chunk of some records; ``stated_length`` is its stated length, ``packed`` its content."""
    data = inside if packed is None else packed
    head = struct.pack("<QQQI", 0, 0, len(inside) if stated_length is None else stated_length, 0)
    return Opcode.CHUNK, head + text(compression) + struct.pack("<Q", len(data)) + data


def schema(number: int, name: str = "s", data: bytes = b"") -> bytes:
    """Return a schema as a record."""
    content = struct.pack("<H", number) + text(name) + text("protobuf") + struct.pack("<I", len(data)) + data
    return record(Opcode.SCHEMA, content)


def attachment(name: str, data: bytes) -> Record:
    """Return an attached file."""
    content = struct.pack("<QQ", 0, 0) + text(name) + text("text/plain") + struct.pack("<Q", len(data)) + data
    return Opcode.ATTACHMENT, content + bytes(4)


def metadata(name: str, values: Mapping[str, str]) -> Record:
    """Return a note."""
    pairs = b"".join(text(key) + text(value) for key, value in values.items())
    return Opcode.METADATA, text(name) + struct.pack("<I", len(pairs)) + pairs


def rewritten(
    source: Path, out: Path, attachments: Mapping[str, bytes] | None = None, about: Mapping[str, str] | None = None
) -> Path:
    """Write a whole recording once more to ``out``, with other or more attached files and values of its header."""
    with McapReader(source) as reader:
        contents, messages = reader.contents(), list(reader.messages())
    file = BytesIO()
    writer = Writer(file, compression=CompressionType.LZ4)
    writer.start()
    for name, note in contents.metadata.items():
        writer.add_metadata(name, {**note, **(about or {})} if name == ABOUT else note)
    for name, data in {**contents.attachments, **(attachments or {})}.items():
        writer.add_attachment(0, 0, name, "text/plain", data)
    known: dict[int, int] = {}
    for message in messages:
        channel = message.channel
        if channel.id not in known:
            known[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, 0)
        writer.add_message(
            known[channel.id], message.log_time_ns, message.data, message.publish_time_ns, message.sequence
        )
    writer.finish()
    out.write_bytes(file.getvalue())
    return out
