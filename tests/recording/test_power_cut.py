"""A power cut: the file ends at any byte, or its last pages never reached the disk; every complete chunk is recovered.

Complete chunks are counted by MCAP's own stream reader, not by this program's.
"""

import io
import struct
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from groundstation.errors import RecordingError
from groundstation.recording.recorder import Recorder, RecorderConfig
from groundstation.recording.recovery import RecoveryResult, recover
from tests.recording.recorded import events, header, looked_at, small_rig

PAGE = 4096


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A flight's recording, as it stands on the disk once it was closed: a cut takes its index first."""
    path = tmp_path_factory.mktemp("cut") / "flight.mcap"
    config = RecorderConfig(patient=True, chunk_bytes=6000, chunk_s=1e9, png_fill=0.0)
    with Recorder(path, small_rig(), header(), config, free_bytes=lambda: 10**12) as recorder:
        for event in recorder.taken(events(25, np.random.default_rng(2))):
            recorder.write(looked_at(event))
    return path.read_bytes()


def complete(data: bytes) -> Counter[str]:
    """Count the messages of each topic in the chunks that are whole, by MCAP's own reader."""
    topics: dict[int, str] = {}
    found: Counter[str] = Counter()
    try:
        for record in StreamReader(io.BytesIO(data), skip_magic=False, emit_chunks=True).records:
            if isinstance(record, Chunk):
                for inner in breakup_chunk(record, validate_crc=True):
                    if isinstance(inner, Channel):
                        topics[inner.id] = inner.topic
                    elif isinstance(inner, Message):
                        found[topics[inner.channel_id]] += 1
    except (McapError, EOFError, RuntimeError, ValueError, struct.error):
        # where it was cut
        pass
    return found


def recovered(path: Path, data: bytes) -> RecoveryResult | None:
    path.write_bytes(data)
    try:
        return recover(path)
    except RecordingError:
        return None


def test_cut_at_any_byte_every_complete_chunk_is_there(data: bytes, tmp_path: Path, rng: np.random.Generator) -> None:
    """Expected: message by message and topic by topic what MCAP's own reader finds before the cut."""
    sizes = set()
    for k, length in enumerate(rng.integers(1, len(data), 50)):
        cut = data[: int(length)]
        done, whole = recovered(tmp_path / f"{k}.mcap", cut), complete(cut)
        if not whole:
            assert done is None
            continue
        assert done is not None
        sizes.add(sum(whole.values()))
        assert (done.messages if done.out is not None else {}) == dict(whole)
        assert complete(done.out.read_bytes() if done.out is not None else b"") == whole
    assert len(sizes) > 10


@pytest.mark.parametrize("filler", ["zeros", "old content"])
def test_pages_that_never_reached_the_disk_cost_no_chunk_before_them(
    data: bytes, filler: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    """Expected: the file has its length, but from some page on holds zeros, or what stood there before."""
    times = 0
    for k, page in enumerate(rng.integers(2, len(data) // PAGE, 15)):
        kept = int(page) * PAGE
        rest = len(data) - kept
        torn = data[:kept] + (bytes(rest) if filler == "zeros" else rng.bytes(rest))
        done, whole = recovered(tmp_path / f"{k}.mcap", torn), complete(data[:kept])
        if whole:
            times += 1
            assert done is not None
            assert done.messages == dict(whole)
    assert times > 10
