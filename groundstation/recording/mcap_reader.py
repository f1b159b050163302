"""Reading an MCAP file record by record, from front to back, with limits: it may be cut short or of unknown origin.

Intact records before a fault are returned first, then the fault is raised. https://mcap.dev/spec
"""

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, TypeVar

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, McapRecord, Metadata, Schema

from groundstation.errors import RecordingError, os_words
from groundstation.files.read_budget import ReadBudget
from groundstation.files.text_file import absence
from groundstation.files.toml_table import quoted, shown

MAGIC = b"\x89MCAP0\r\n"
# a chunk of ours is a megabyte and one picture, of 78 MB at most
MAX_RECORD_BYTES = 80 * 2**20
MAX_ATTACHED_BYTES = 512 * 2**20
_MAX_CHANNELS = 10_000
_MAX_METADATA = 1_000
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
R = TypeVar("R", bound=McapRecord)
A = TypeVar("A", Schema, Channel)


@dataclass(frozen=True, slots=True, kw_only=True)
class McapMessage:
    """One message: channel, schema, sequence number and time stamps; ``offset`` is that of its chunk in the file."""

    channel: Channel
    schema: Schema | None
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes
    offset: int

    @property
    def topic(self) -> str:
        """The topic of its channel."""
        return self.channel.topic


@dataclass(frozen=True, slots=True, kw_only=True)
class McapContents:
    """The records of a file other than messages: attachments and metadata by name, and the number of chunks.

    ``whole_bytes`` is the end of the last intact record, ``fault`` the fault after it; None in a closed file.
    """

    attachments: dict[str, bytes]
    metadata: dict[str, dict[str, str]]
    chunks: int
    whole_bytes: int
    fault: RecordingError | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _RecordSpan:
    """Place of a record's content in the file."""

    opcode: int
    offset: int
    length: int


class McapReader:
    """An open MCAP file; raises `RecordingError` if it is none. A context manager.

    No record or chunk larger than `MAX_RECORD_BYTES`, compressed or not, is read into memory.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        # a pipe or a device has no end and cannot seek
        if not path.is_file():
            raise RecordingError(str(path), got=absence(path), wanted="a recording, .mcap")
        try:
            self._stream: BinaryIO = path.open("rb")
        except OSError as fault:
            raise RecordingError(str(path), got=os_words(fault), wanted="a file that can be read") from fault
        self._size = os.fstat(self._stream.fileno()).st_size
        if self._read(0, len(MAGIC)) != MAGIC:
            self._stream.close()
            raise RecordingError(str(path), got="a file that is no MCAP", wanted="a recording, .mcap")

    def __enter__(self) -> "McapReader":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stream.close()

    def contents(self) -> McapContents:
        """Read the file once without decompressing its chunks; a fault is in the result."""
        attachments: dict[str, bytes] = {}
        metadata: dict[str, dict[str, str]] = {}
        chunks = attached = 0
        end, fault = len(MAGIC), None
        try:
            for place in self._places():
                if place.opcode == Opcode.ATTACHMENT:
                    attached += place.length
                    if attached > MAX_ATTACHED_BYTES:
                        raise self._fault(place.offset, "more attached", f"at most {MAX_ATTACHED_BYTES >> 20} MiB")
                    file = self._parsed(Attachment, place)
                    attachments[file.name] = file.data
                elif place.opcode == Opcode.METADATA and len(metadata) < _MAX_METADATA:
                    note = self._parsed(Metadata, place)
                    metadata[note.name] = note.metadata
                chunks += place.opcode == Opcode.CHUNK
                end = place.offset + place.length
        except RecordingError as error:
            fault = error
        return McapContents(attachments=attachments, metadata=metadata, chunks=chunks, whole_bytes=end, fault=fault)

    def messages(self, skip: Callable[[RecordingError], None] | None = None) -> Iterator[McapMessage]:
        """Yield all messages in the file's order.

        Raises `RecordingError` at the first fault; with ``skip``, a chunk damaged inside is reported to it and left
        out instead.
        """
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        budget = ReadBudget(self.path.name, self._size)
        for place in self._places():
            if place.opcode == Opcode.CHUNK:
                try:
                    # no reference to a chunk remains while the next one is decompressed
                    yield from self._inside(place, schemas, channels, budget)
                except RecordingError as fault:
                    if skip is None:
                        raise
                    skip(fault)

    def _inside(
        self, place: _RecordSpan, schemas: dict[int, Schema], channels: dict[int, Channel], budget: ReadBudget
    ) -> Iterator[McapMessage]:
        """Yield the messages of one chunk."""
        data, where = self._unpacked(place, budget), self._where(place.offset)
        yield from _ChunkReader(data, where, schemas, channels, budget).messages(place.offset)

    # ----------------------------------------------------------------------------------- the file's records
    def _places(self) -> Iterator[_RecordSpan]:
        """Yield the records up to the end of the data; raises `RecordingError` where the file ends before it."""
        at = len(MAGIC)
        while True:
            head = self._read(at, _HEAD.size)
            if len(head) < _HEAD.size:
                raise self._fault(at, "the end of the file", "a recording that was closed")
            opcode, length = _HEAD.unpack(head)
            at += _HEAD.size
            if length > self._size - at:
                raise self._fault(at, "an unfinished record", "a recording that was closed")
            if length > MAX_RECORD_BYTES:
                raise self._fault(at, f"a record of {length} bytes", f"at most {MAX_RECORD_BYTES >> 20} MiB")
            yield _RecordSpan(opcode=opcode, offset=at, length=length)
            if opcode == Opcode.DATA_END:
                break
            at += length
        if self._read(max(self._size - len(MAGIC), at), len(MAGIC)) != MAGIC:
            raise self._fault(at, "no proper end", "a recording that was closed")

    def _read(self, at: int, length: int) -> bytes:
        try:
            self._stream.seek(at)
            return self._stream.read(length)
        except OSError as fault:
            raise RecordingError(str(self.path), got=os_words(fault), wanted="a file that can be read") from fault

    def _parsed(self, kind: type[R], place: _RecordSpan) -> R:
        return _parse(kind, self._read(place.offset, place.length), self._where(place.offset))

    def _unpacked(self, place: _RecordSpan, budget: ReadBudget) -> bytes | memoryview:
        """Return the decompressed content of a chunk; raises `RecordingError` if it is damaged or too large."""
        chunk = self._parsed(Chunk, place)
        if chunk.uncompressed_size > MAX_RECORD_BYTES:
            got = f"a chunk of {chunk.uncompressed_size} bytes"
            raise self._fault(place.offset, got, f"at most {MAX_RECORD_BYTES >> 20} MiB")
        budget.unpack(chunk.uncompressed_size)
        try:
            data = _decompressed(chunk)
        except (RuntimeError, ValueError, MemoryError, zstandard.ZstdError) as error:
            raise self._fault(place.offset, f"a damaged chunk ({shown(str(error))})", "a whole one") from error
        if len(data) != chunk.uncompressed_size or (chunk.uncompressed_crc not in (0, zlib.crc32(data))):
            raise self._fault(place.offset, "a damaged chunk", "a whole one")
        return data

    def _where(self, offset: int) -> str:
        return f"{self.path.name}: byte {offset}"

    def _fault(self, offset: int, got: str, wanted: str) -> RecordingError:
        return RecordingError(self._where(offset), got=got, wanted=wanted)


class _ChunkReader:
    """Reads the records of one decompressed chunk; its schemas and channels are valid in later chunks too."""

    def __init__(
        self,
        data: bytes | memoryview,
        where: str,
        schemas: dict[int, Schema],
        channels: dict[int, Channel],
        budget: ReadBudget,
    ) -> None:
        # slices of a view are no copies
        self._data = memoryview(data)
        self._budget = budget
        self._where = where
        self._schemas = schemas
        self._channels = channels
        # as they were announced: a file may repeat them millions of times, and the library takes half a millisecond
        self._announced: dict[tuple[type, bytes], Schema | Channel] = {}

    def messages(self, offset: int) -> Iterator[McapMessage]:
        """Yield the messages; raises `RecordingError` where a record is damaged."""
        at, data = 0, self._data
        while at < len(data):
            if at + _HEAD.size > len(data):
                raise self._fault("a record cut short")
            opcode, length = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if length > len(data) - at:
                raise self._fault("a record cut short")
            content = data[at : at + length]
            at += length
            self._budget.record()
            if opcode == Opcode.MESSAGE:
                yield self._message(content, offset)
            elif opcode == Opcode.SCHEMA:
                self._budget.announce(length)
                schema = self._parsed(Schema, bytes(content))
                self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                self._budget.announce(length)
                channel = self._parsed(Channel, bytes(content))
                self._channels[channel.id] = channel
            if len(self._channels) + len(self._schemas) > _MAX_CHANNELS:
                raise self._fault("more channels", f"at most {_MAX_CHANNELS}")

    def _parsed(self, kind: type[A], content: bytes) -> A:
        """Return an announced schema or channel; the same bytes are parsed once."""
        known = self._announced.get((kind, content))
        if not isinstance(known, kind):
            known = self._announced[kind, content] = _parse(kind, content, self._where)
        return known

    def _message(self, content: memoryview, offset: int) -> McapMessage:
        if len(content) < _MESSAGE.size:
            raise self._fault("a message cut short")
        number, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
        channel = self._channels.get(number)
        if channel is None:
            raise self._fault(f"a message of channel {number}", "a channel that was announced")
        return McapMessage(
            channel=channel,
            schema=self._schemas.get(channel.schema_id),
            sequence=sequence,
            log_time_ns=log_time,
            publish_time_ns=publish_time,
            data=bytes(content[_MESSAGE.size :]),
            offset=offset,
        )

    def _fault(self, got: str, wanted: str = "a whole chunk") -> RecordingError:
        return RecordingError(self._where, got=got, wanted=wanted)


def _parse(kind: type[R], data: bytes, where: str) -> R:
    """Return one record of the library's; raises `RecordingError` where the bytes are none."""
    try:
        # every record has such a reader; their common base does not say so
        record: R = kind.read(ReadDataStream(BytesIO(data)))  # type: ignore[attr-defined]
    except (McapError, struct.error, ValueError, OverflowError, MemoryError) as error:
        raise RecordingError(where, got=f"a damaged {kind.__name__.lower()}", wanted="a whole one") from error
    return record


def _decompressed(chunk: Chunk) -> bytes | memoryview:
    """Unpack a chunk's data, at most its stated length and one byte."""
    most = chunk.uncompressed_size + 1
    if chunk.compression == "":
        return chunk.data
    if chunk.compression == "lz4":
        unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most)
        return unpacked
    if chunk.compression == "zstd":
        # memory is allocated once, for the chunk's stated length
        room = memoryview(bytearray(most))
        filled = 0
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as stream:
            while filled < most and (count := stream.readinto(room[filled:])):
                filled += count
        return room[:filled]
    raise ValueError(f"packed by {quoted(chunk.compression)}")
