"""What Rerun's reader of MP4 files would not come to an end with, and what every whole file passes."""

import struct
from pathlib import Path

import pytest

from groundstation.errors import SessionError
from groundstation.sinks.mp4_tables import mp4_fault
from groundstation.viewer.media import VideoAsset, load_video
from tests.session.folder import write_video

ROOT = Path(__file__).resolve().parents[2]


def test_whole_files_pass(tmp_path: Path) -> None:
    write_video(tmp_path / "own.mp4", range(4), "mp4v")
    for path in (tmp_path / "own.mp4", *(ROOT / "recordings" / "landing-1").glob("*.mp4")):
        assert mp4_fault(path) == ""


def spoilt(path: Path, kind: bytes, offset: int, value: int) -> Path:
    """A video with one number changed, so many bytes behind the name of a box."""
    write_video(path, range(4), "mp4v")
    content = bytearray(path.read_bytes())
    place = content.index(kind) + 4 + offset
    content[place : place + 4] = struct.pack(">I", value)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("kind", "offset", "value", "message"),
    [
        # a note of zero length: the reader would not advance
        (b"ilst", -8, 0, "a box of 0 bytes in 'meta'"),
        (b"stts", -8, 4, "a box of 4 bytes in 'stbl'"),
        (b"stbl", -8, 2**31, "a box of 2147483648 bytes in 'minf'"),
        (b"moov", -8, 2**31, "a box of 2147483648 bytes at"),
        (b"stts", 4, 2**32 - 1, "a table stts of 4294967295 entries"),
        (b"stts", 8, 2**32 - 1, "a table stts of 4294967295 samples"),
        (b"stsz", 8, 2**32 - 1, "a table of 4294967295 sample sizes"),
        (b"stsc", 12, 2**32 - 1, "a table stsc of chunks that cannot be"),
        (b"stco", 4, 2**31, "a table stco of 2147483648 entries"),
        # tables that contradict each other: the reader aborts the process
        (b"stts", 8, 1, "a table stts of 1 samples, where 4 have a size"),
        (b"stsc", 12, 1, "1 chunks of 1 samples, where 4 have a size"),
        (b"stsc", 8, 2, "a table stsc that does not fit 1 chunks"),
        (b"stsc", 4, 0, "a table stsc that does not fit 1 chunks"),
    ],
)
def test_impossible_tables_are_reported_and_not_read(
    tmp_path: Path, kind: bytes, offset: int, value: int, message: str
) -> None:
    path = spoilt(tmp_path / "left.mp4", kind, offset, value)
    assert mp4_fault(path).startswith(message)
    with pytest.raises(SessionError, match=message.replace("'", "."), check=lambda e: "left.mp4" in str(e)):
        load_video(VideoAsset(path=path))


@pytest.mark.parametrize(
    ("holders", "zeros", "message"),
    [
        ((b"moov", b"udta"), 8, "a box of 0 bytes in 'udta'"),
        ((b"moov",), 12, "a box of 0 bytes in 'moov'"),
        ((b"moov", b"trak"), 4, "4 bytes after the boxes in 'trak'"),
        ((b"moov", b"trak", b"mdia", b"minf", b"stbl"), 128, "a box of 0 bytes in 'stbl'"),
        ((b"moov", b"trak", b"mdia", b"minf", b"dinf"), 4, "4 bytes after the boxes in 'dinf'"),
        # QuickTime's end of user data
        ((b"moov", b"udta"), 4, ""),
    ],
)
def test_zeros_after_the_last_box(tmp_path: Path, holders: tuple[bytes, ...], zeros: int, message: str) -> None:
    """Expected: refused where Rerun's reader does not end (found by `benchmarks/reader_fuzz.py`)."""
    path = tmp_path / "left.mp4"
    write_video(path, range(4), "mp4v")
    content = bytearray(path.read_bytes())
    place = content.index(holders[-1]) - 4
    end = place + struct.unpack_from(">I", content, place)[0]
    content[end:end] = bytes(zeros)
    for kind in holders:
        place = content.index(kind) - 4
        struct.pack_into(">I", content, place, struct.unpack_from(">I", content, place)[0] + zeros)
    path.write_bytes(content)
    fault = mp4_fault(path)
    assert fault.startswith(message)
    assert bool(fault) is bool(message)
