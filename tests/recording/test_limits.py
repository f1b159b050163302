"""Bounds of a recording's reader and writer: at the bound it is taken, beyond it refused, by that bound's word.

The bounds are made small, and the file is written by MCAP's own writer or by hand.
"""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from groundstation.errors import InputError, RecordingError
from groundstation.recording import mcap_reader
from groundstation.recording.mcap_metadata import RecordingHeader
from groundstation.recording.mcap_reader import MAGIC, McapReader
from groundstation.recording.recorder import Recorder, RecorderConfig
from tests.complaints import complaint
from tests.recording.recorded import header, small_rig

MIB = 2**20


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def schema(number: int) -> bytes:
    return record(Opcode.SCHEMA, struct.pack("<H", number) + text("s") + text("") + struct.pack("<I", 0))


def channel(number: int, schema_number: int = 0) -> bytes:
    numbers = struct.pack("<HH", number, schema_number)
    return record(Opcode.CHANNEL, numbers + text(f"/{number}") + text("json") + struct.pack("<I", 0))


def message(channel_number: int, size: int) -> bytes:
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", channel_number, 0, 1, 1) + bytes(size))


def chunk(content: bytes, packing: str = "", stated_length: int | None = None) -> bytes:
    pack: dict[str, Callable[[bytes], bytes]] = {
        "": bytes,
        "lz4": lz4.frame.compress,
        "zstd": zstandard.ZstdCompressor().compress,
    }
    packed = pack[packing](content)
    size = len(content) if stated_length is None else stated_length
    head = struct.pack("<QQQI", 1, 1, size, zlib.crc32(content) if stated_length is None else 0)
    return record(Opcode.CHUNK, head + text(packing) + struct.pack("<Q", len(packed)) + packed)


def attachment(name: str, size: int) -> bytes:
    content = struct.pack("<QQ", 0, 0) + text(name) + text("") + struct.pack("<Q", size) + bytes(size)
    return record(Opcode.ATTACHMENT, content + struct.pack("<I", 0))


def note(name: str) -> bytes:
    return record(Opcode.METADATA, text(name) + struct.pack("<I", 0))


END = record(Opcode.DATA_END, struct.pack("<I", 0)) + MAGIC


def written(folder: Path, *records: bytes) -> Path:
    path = folder / "made.mcap"
    path.write_bytes(MAGIC + b"".join(records) + END)
    return path


def sizes(path: Path) -> list[int]:
    with McapReader(path) as reader:
        return [len(m.data) for m in reader.messages()]


def refused(path: Path) -> str:
    return complaint(RecordingError, lambda: sizes(path))


def test_a_record_beyond_the_bound_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: of a chunk that is all there, packed longer than its content; one byte decides."""
    noise = np.random.default_rng(1).bytes(2 * MIB)
    whole = chunk(channel(1) + record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 1, 1) + noise), "lz4")
    path = written(tmp_path, whole)
    length = len(whole) - 9
    monkeypatch.setattr(mcap_reader, "MAX_RECORD_BYTES", length)
    assert sizes(path) == [2 * MIB]
    monkeypatch.setattr(mcap_reader, "MAX_RECORD_BYTES", length - 1)
    assert refused(path) == f"made.mcap: byte 17: got a record of {length} bytes; wanted at most 2 MiB"


def test_a_record_of_the_real_bound_is_not_read_either(tmp_path: Path) -> None:
    """Expected: a file with a hole as large as the length that a record claims costs nothing."""
    path, length = tmp_path / "made.mcap", mcap_reader.MAX_RECORD_BYTES + 1
    path.write_bytes(MAGIC + struct.pack("<BQ", Opcode.CHUNK, length))
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size + length + len(END))
    assert refused(path) == f"made.mcap: byte 17: got a record of {length} bytes; wanted at most 80 MiB"
    with McapReader(path) as reader:
        assert f"got a record of {length} bytes" in str(reader.contents().fault)


@pytest.mark.parametrize("packing", ["", "lz4", "zstd"])
def test_a_chunk_that_unpacks_to_more_than_the_bound_is_refused(
    packing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: however short it is in the file; nothing of it is unpacked; one byte decides."""
    content = channel(1) + message(1, 2 * MIB)
    path = written(tmp_path, chunk(content, packing))
    room = len(content) + (200 if packing == "" else 0)
    monkeypatch.setattr(mcap_reader, "MAX_RECORD_BYTES", room)
    assert sizes(path) == [2 * MIB]
    if packing == "":
        # not packed, the record itself is the longer
        return
    monkeypatch.setattr(mcap_reader, "MAX_RECORD_BYTES", len(content) - 1)
    monkeypatch.setattr(mcap_reader, "_decompressed", None)
    assert refused(path) == f"made.mcap: byte 17: got a chunk of {len(content)} bytes; wanted at most 2 MiB"


@pytest.mark.parametrize("packing", ["lz4", "zstd"])
@pytest.mark.parametrize("less", [1, 1000])
def test_no_more_is_unpacked_than_a_chunk_states(packing: str, less: int, tmp_path: Path) -> None:
    """Expected: a chunk that unpacks to more than stated is damaged, and is unpacked to one byte more than that."""
    content = channel(1) + message(1, 5000)
    path = written(tmp_path, chunk(content, packing, stated_length=len(content) - less))
    assert refused(path) == "made.mcap: byte 17: got a damaged chunk; wanted a whole one"
    with McapReader(path) as reader:
        (place,) = [p for p in reader._places() if p.opcode == Opcode.CHUNK]
        stated = mcap_reader._parse(mcap_reader.Chunk, reader._read(place.offset, place.length), "")
        assert len(mcap_reader._decompressed(stated)) == len(content) - less + 1


def test_all_attached_files_together_have_a_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: each alone is small; the one that passes the bound is not read, those before it are there."""
    files = [attachment(f"{k}.csv", MIB) for k in range(3)]
    path = written(tmp_path, *files)
    length = len(files[0]) - 9
    for bound, names, fault in (
        (3 * length, ["0.csv", "1.csv", "2.csv"], "None"),
        (3 * length - 1, ["0.csv", "1.csv"], "got more attached; wanted at most 3 MiB"),
        (length, ["0.csv"], "got more attached; wanted at most 1 MiB"),
    ):
        monkeypatch.setattr(mcap_reader, "MAX_ATTACHED_BYTES", bound)
        with McapReader(path) as reader:
            contents = reader.contents()
        assert list(contents.attachments) == names
        assert fault in str(contents.fault)


@pytest.mark.parametrize("split", [1, 3])
def test_channels_and_schemas_together_have_a_bound(
    split: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: counted over all chunks of a file."""
    made = [schema(k + 1) for k in range(3)] + [channel(k + 1, k + 1) for k in range(3)]
    parts = [made[k::split] for k in range(split)]
    path = written(tmp_path, *[chunk(b"".join(part)) for part in parts], chunk(message(1, 7)))
    monkeypatch.setattr(mcap_reader, "_MAX_CHANNELS", 6)
    assert sizes(path) == [7]
    monkeypatch.setattr(mcap_reader, "_MAX_CHANNELS", 5)
    assert refused(path).endswith("got more channels; wanted at most 5")


def test_notes_beyond_their_bound_are_passed_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, *[note(f"note {k}") for k in range(4)])
    monkeypatch.setattr(mcap_reader, "_MAX_METADATA", 3)
    with McapReader(path) as reader:
        assert list(reader.contents().metadata) == ["note 0", "note 1", "note 2"]


def test_the_makers_own_writer_is_within_all_bounds(tmp_path: Path) -> None:
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        number = writer.register_channel("/a", "json", writer.register_schema("s", "jsonschema", b"{}"))
        for k in range(3):
            writer.add_message(number, k, bytes(10 * k), k)
        writer.finish()
    assert sizes(path) == [0, 10, 20]


@pytest.mark.parametrize("less", [0, 1])
def test_a_file_too_large_to_be_attached_is_refused(less: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: one line, no file that is in the way of the next attempt; at the bound it is attached whole."""
    size = 2 * MIB + 1 - less
    monkeypatch.setattr("groundstation.recording.mcap_writer._MAX_FILE_BYTES", 2 * MIB)
    path, plain = tmp_path / "flight.mcap", header()
    made = RecordingHeader(name=plain.name, files={**plain.files, "dgps.csv": bytes(size)})

    def record() -> None:
        Recorder(path, small_rig(), made, RecorderConfig(), free_bytes=lambda: 10**12).close()

    if less:
        record()
        with McapReader(path) as reader:
            assert len(reader.contents().attachments["dgps.csv"]) == size
    else:
        reported = complaint(InputError, record)
        assert reported == f"dgps.csv: got {size} bytes; wanted at most 2 MiB to go into a recording"
        assert not path.exists()
