"""A recording that was cut, garbled or made up: intact records are read, then one clear error is raised."""

import struct
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from groundstation.errors import InputError, RecordingError
from groundstation.recording import mcap_reader
from groundstation.recording.mcap_reader import MAGIC, McapReader
from groundstation.recording.recorder import PATIENT, Recorder
from groundstation.recording.recovery import recover
from tests.recording.recorded import events, header, looked_at, played, same, small_rig

PAIRS = 25


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "flight.mcap"
    config = type(PATIENT)(patient=True, chunk_bytes=4096, chunk_s=1e9)
    with Recorder(path, small_rig(), header(), config, free_bytes=lambda: 10**12) as recorder:
        for event in recorder.taken(events(PAIRS, np.random.default_rng(1))):
            recorder.write(looked_at(event))
    return path


def count(path: Path) -> int:
    """How many messages stand in a file before its first fault."""
    found = 0
    with McapReader(path) as reader:
        try:
            for _ in reader.messages():
                found += 1
        except RecordingError:
            pass
    return found


def test_it_plays_the_recorded_events(recording: Path) -> None:
    back, source = played(recording)
    given = list(events(PAIRS, np.random.default_rng(1)))
    assert len(back) == len(given)
    assert all(same(one, other) for one, other in zip(given, back, strict=True))
    assert not source.missing
    assert (source.epoch_count, source.span_s) == (PAIRS, (100.0, 100.0 + (PAIRS - 1) / 30.0))


def test_cut_anywhere_the_whole_chunks_are_recovered(recording: Path, tmp_path: Path, rng: np.random.Generator) -> None:
    data = recording.read_bytes()
    total = count(recording)
    for k, length in enumerate(rng.integers(len(MAGIC), len(data), 25)):
        cut = tmp_path / f"{k}.mcap"
        cut.write_bytes(data[:length])
        before = count(cut)
        try:
            done = recover(cut)
        except RecordingError:
            assert before == 0
            continue
        assert cut.read_bytes() == data[:length]
        assert done.out is not None
        assert sum(done.messages.values()) == count(done.out) == before <= total
        with pytest.raises(InputError, match="a file that exists"):
            recover(cut)


def test_a_recovered_recording_plays_up_to_the_cut(recording: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recording.read_bytes()[: recording.stat().st_size // 2])
    out = recover(cut).out
    assert out is not None
    back, source = played(out)
    given = list(events(PAIRS, np.random.default_rng(1)))
    assert 20 < len(back) < len(given)
    # a frame whose pixels were lost with the last chunk is not sent
    kept = len(back) - source.missing.frames
    assert all(same(one, other) for one, other in zip(given[:kept], back[:kept], strict=True))
    assert source.missing.frames <= 2


def test_a_whole_recording_needs_no_recovery(recording: Path, tmp_path: Path) -> None:
    done = recover(recording, tmp_path / "new.mcap")
    assert done.out is None
    assert not (tmp_path / "new.mcap").exists()
    assert sum(done.messages.values()) == count(recording)


def test_garbled_files_end_with_one_error(recording: Path, tmp_path: Path, rng: np.random.Generator) -> None:
    data = np.frombuffer(recording.read_bytes(), np.uint8)
    path = tmp_path / "garbled.mcap"
    refused = 0
    for _ in range(60):
        garbled = data.copy()
        # half of them near the front, where the header and the first chunk are
        end = len(data) if rng.random() < 0.5 else 3000
        places = rng.integers(0, end, rng.integers(1, 6))
        garbled[places] = rng.integers(0, 256, len(places))
        path.write_bytes(garbled.tobytes())
        try:
            played(path)
        except InputError:
            refused += 1
    assert refused > 20


def test_a_damaged_chunk_is_left_out(recording: Path, tmp_path: Path) -> None:
    data = bytearray(recording.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    done = recover(path)
    assert done.skipped == 1
    assert 0 < sum(done.messages.values()) < count(recording)
    assert done.out is not None
    back, source = played(done.out)
    assert source.missing.events + source.missing.frames > 0
    assert source.missing.first_epoch is not None
    given = list(events(PAIRS, np.random.default_rng(1)))
    assert len(back) + source.missing.events + source.missing.frames == len(given)


@pytest.mark.parametrize(
    ("stated_length", "got", "wanted"),
    [
        (100, "a damaged chunk", "a whole one"),
        # the bound itself is permitted, one byte more is not
        (10_000, "a damaged chunk", "a whole one"),
        (10_001, "a chunk of 10001 bytes", "at most 0 MiB"),
        (2**62, f"a chunk of {2**62} bytes", "at most 0 MiB"),
    ],
)
def test_a_chunk_that_unpacks_to_more_than_stated_or_allowed_is_refused(
    stated_length: int, got: str, wanted: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_reader, "MAX_RECORD_BYTES", 10_000)
    # less than the bound in the file, 5 MB unpacked
    packed = lz4.frame.compress(bytes(1_000_000))
    assert len(packed) < 9_000
    chunk = (
        struct.pack("<QQQI", 0, 0, stated_length, 0)
        + struct.pack("<I", 3)
        + b"lz4"
        + struct.pack("<Q", len(packed))
        + packed
    )
    path = tmp_path / "bomb.mcap"
    path.write_bytes(MAGIC + struct.pack("<BQ", Opcode.CHUNK, len(chunk)) + chunk)
    with McapReader(path) as reader, pytest.raises(RecordingError) as fault:
        list(reader.messages())
    assert str(fault.value) == f"bomb.mcap: byte {len(MAGIC) + 9}: got {got}; wanted {wanted}"


def test_a_record_of_any_length_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "long.mcap"
    path.write_bytes(MAGIC + struct.pack("<BQ", Opcode.ATTACHMENT, 2**63) + bytes(100))
    with McapReader(path) as reader:
        contents = reader.contents()
    assert contents.fault is not None
    assert "unfinished record" in str(contents.fault)


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("hello")
    with pytest.raises(RecordingError, match="no MCAP"):
        played(tmp_path / "text.mcap")
    with (tmp_path / "other.mcap").open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        writer.finish()
    with pytest.raises(RecordingError, match="another program's file"):
        played(tmp_path / "other.mcap")
    # a recording of its own that ends within its first record is not called another program's
    (tmp_path / "tiny.mcap").write_bytes((tmp_path / "other.mcap").read_bytes()[:20])
    with pytest.raises(RecordingError, match="got an unfinished record before the header"):
        played(tmp_path / "tiny.mcap")
    with pytest.raises(InputError, match="no such file"):
        played(tmp_path / "none.mcap")
