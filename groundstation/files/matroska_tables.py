"""Whether a Matroska file contains each of its tables once, checked before a decoder stores every copy.

A file has one table of tracks, one of tags and a few more. FFmpeg, which searches for the next element after invalid
bytes, stores every table it finds: 240 kB with 943 copies used 336 MB (found by `benchmarks/reader_fuzz.py`).
"""

import mmap
from pathlib import Path

_EBML = b"\x1a\x45\xdf\xa3"
# Info, Tracks, SeekHead, Cues, Tags, Attachments, Chapters (RFC 9559, 5.1); programs write each once or twice
_TABLES = tuple(
    bytes.fromhex(name) for name in ("1549a966", "1654ae6b", "114d9b74", "1c53bb6b", "1254c367", "1941a469", "1043a770")
)
# by chance such four bytes stand in 4 GB of pictures once
_MOST = 32
_SEARCHED_BYTES = 1 << 28


def repeats_tables(path: Path) -> bool:
    """Return whether a file is Matroska or WebM and repeats any of its tables many times, in its first 256 MB."""
    try:
        with path.open("rb") as file:
            if file.read(len(_EBML)) != _EBML:
                return False
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                return any(_occurs_often(content, name) for name in _TABLES)
    except (OSError, ValueError):
        # opening the file reports why it cannot be read
        return False


def _occurs_often(content: mmap.mmap, name: bytes) -> bool:
    """Return whether four bytes stand in a file more often than a table does."""
    place = -1
    for _ in range(_MOST + 1):
        place = content.find(name, place + 1, _SEARCHED_BYTES)
        if place < 0:
            return False
    return True
