"""Consistency of the boxes of an MP4 file: a reader that trusts a damaged one may not terminate.

ISO/IEC 14496-12: nested boxes (4.2), and in section 8.6 and 8.7 the tables `stts` and `ctts`, runs of samples,
`stsc`, samples per chunk, `stsz`, the samples' sizes, `stco` and `co64`, the chunks.
"""

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

# boxes that contain boxes, on the path to the tables and next to it
_HOLDERS = (b"moov", b"trak", b"mdia", b"minf", b"dinf", b"stbl", b"edts", b"udta", b"ilst", b"mvex", b"meta")
# bytes of an entry, after a full box's version and flags and the number of entries
_ENTRY_BYTES = {b"stts": 8, b"ctts": 8, b"stsc": 12, b"stco": 4, b"co64": 8, b"stss": 4, b"elst": 12}
_MAY_END_EARLY = (b"moov", b"udta", b"meta", b"ilst", b"")
_HEAD = 8
_DEEPEST = 10


class _InconsistentTableError(Exception):
    """What cannot be, in words."""


def mp4_fault(path: Path) -> str:
    """Return what cannot be true of an MP4 file, in words; nothing where all can be, or it is no MP4."""
    try:
        for kind, body in _outer(path, (b"moov",)):
            _check(kind, body, path.stat().st_size, 0)
    except _InconsistentTableError as fault:
        return str(fault)
    return ""


def mp4_moov(path: Path) -> tuple[bytes, bytes]:
    """Return the bodies of a file's `ftyp` and `moov`; raises `KeyError` where one is missing."""
    found = dict(_outer(path, (b"ftyp", b"moov")))
    return found[b"ftyp"], found[b"moov"]


def mp4_boxes(body: bytes, holder: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of the boxes in one of a file without fault; raises `ValueError` where that is not so."""
    try:
        yield from _boxes(body, holder)
    except _InconsistentTableError as fault:
        raise ValueError(str(fault)) from fault


def _outer(path: Path, kinds: tuple[bytes, ...]) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of the file's own boxes of these kinds; raises `_InconsistentTableError`."""
    file_bytes = path.stat().st_size
    with path.open("rb") as file:
        place = 0
        while place + 2 * _HEAD <= file_bytes:
            file.seek(place)
            size, kind, long = struct.unpack(">I4sQ", file.read(2 * _HEAD))
            size = {0: file_bytes - place, 1: long}.get(size, size)
            if size < _HEAD or place + size > file_bytes:
                raise _InconsistentTableError(f"a box of {size} bytes at {place}, in a file of {file_bytes}")
            if kind in kinds:
                file.seek(place + _HEAD)
                yield kind, file.read(size - _HEAD)
            place += size


def _check(kind: bytes, body: bytes, file_bytes: int, depth: int) -> None:
    """Raise `_InconsistentTableError` for a box, or one in it, that cannot be."""
    if kind in _HOLDERS or kind == b"":
        if depth > _DEEPEST:
            raise _InconsistentTableError(f"boxes more than {_DEEPEST} deep")
        # the box of notes has version and flags in front, but not QuickTime's
        skipped = 4 if kind == b"meta" and body[4:8] != b"hdlr" else 0
        for inner, content in _boxes(body[skipped:], kind):
            # each note is a box with boxes
            _check(b"" if kind == b"ilst" else inner, content, file_bytes, depth + 1)
        if kind == b"stbl":
            _check_samples(dict(_boxes(body, kind)))
    elif kind == b"stsz" and len(body) >= 12:
        same, count = struct.unpack(">II", body[4:12])
        if count > file_bytes or (not same and 12 + 4 * count > len(body)):
            raise _InconsistentTableError(f"a table of {count} sample sizes in {len(body)} bytes")
    elif kind in _ENTRY_BYTES and len(body) >= _HEAD:
        _check_table(kind, body, file_bytes)


def _boxes(body: bytes, holder: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield kind and content of the boxes in a box.

    Zeros after the last box are a box of length zero to Rerun's reader, which then does not advance; so are fewer than
    eight of them inside a track. QuickTime ends its user data with four, which the reader reports as an error.
    """
    place = 0
    while place + _HEAD <= len(body):
        size, kind = struct.unpack(">I4s", body[place : place + _HEAD])
        if size < _HEAD or place + size > len(body):
            name = holder.decode("latin-1") or "a note"
            raise _InconsistentTableError(f"a box of {size} bytes in {name!r}, where {len(body) - place} are left")
        yield kind, body[place + _HEAD : place + size]
        place += size
    if place < len(body) and holder not in _MAY_END_EARLY:
        raise _InconsistentTableError(f"{len(body) - place} bytes after the boxes in {holder.decode('latin-1')!r}")


def _check_table(kind: bytes, body: bytes, most: int) -> None:
    """Raise `_InconsistentTableError` for a table larger than its box, or with more samples than the file has bytes."""
    (count,) = struct.unpack(">I", body[4:8])
    name, entry = kind.decode(), _ENTRY_BYTES[kind]
    if 8 + entry * count > len(body):
        raise _InconsistentTableError(f"a table {name} of {count} entries in {len(body)} bytes")
    if kind in (b"stts", b"ctts"):
        samples = int(np.frombuffer(body, ">u4", 2 * count, 8)[::2].sum(dtype=np.uint64))
        if samples > most:
            raise _InconsistentTableError(f"a table {name} of {samples} samples in {most} bytes")
    if kind == b"stsc" and count:
        rows = np.frombuffer(body, ">u4", 3 * count, 8).reshape(-1, 3)[:, :2].astype(np.int64)
        if rows.max() > most or rows.min() < 1 or np.any(np.diff(rows[:, 0]) <= 0):
            raise _InconsistentTableError("a table stsc of chunks that cannot be")


def _check_samples(tables: dict[bytes, bytes]) -> None:
    """Raise `_InconsistentTableError` where a track's tables, each valid alone, do not describe the same samples.

    Rerun's reader aborts the process at a sample beyond the end of the chunks or of the times.
    """
    if len(tables.get(b"stsz", b"")) < 12:
        return
    count = struct.unpack(">I", tables[b"stsz"][8:12])[0]
    for name in (b"stts", b"ctts"):
        if name in tables:
            timed = int(_column(tables[name], 2, 0).sum())
            if timed < count:
                raise _InconsistentTableError(f"a table {name.decode()} of {timed} samples, where {count} have a size")
    chunks = max(len(_column(tables.get(b"stco", b""), 1, 0)), len(_column(tables.get(b"co64", b""), 2, 0)))
    first, per_chunk = _column(tables.get(b"stsc", b""), 3, 0), _column(tables.get(b"stsc", b""), 3, 1)
    if count and (len(first) == 0 or first[0] != 1 or first[-1] > chunks):
        raise _InconsistentTableError(f"a table stsc that does not fit {chunks} chunks")
    placed = int(per_chunk @ np.diff([*first.tolist(), chunks + 1])) if count else 0
    if placed < count:
        raise _InconsistentTableError(f"{chunks} chunks of {placed} samples, where {count} have a size")


def _column(body: bytes, columns: int, column: int) -> NDArray[np.int64]:
    """Return one column of a table's entries of four bytes each; nothing of a table that is not there."""
    count = struct.unpack(">I", body[4:8])[0] if len(body) >= _HEAD else 0
    return np.frombuffer(body, ">u4", columns * count, min(_HEAD, len(body)))[column::columns].astype(np.int64)
