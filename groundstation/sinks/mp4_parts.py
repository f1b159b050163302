"""A long MP4 video as short ones: the same samples, not encoded again, cut where a decoder can begin.

ISO/IEC 14496-12, sections 8.5 to 8.7: the tables of a track are read into an array each, of a stretch of samples they
are rewritten. A cut is at a sync sample with all earlier pictures shown before it and all later ones after it, so
that the pictures of one part after the other are those of the whole, in order.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from groundstation.errors import SessionError
from groundstation.sinks.mp4_tables import mp4_boxes, mp4_moov

_Counts = NDArray[np.int64]
_Boxes = dict[bytes, bytes]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mp4Samples:
    """The samples of a file's one video track, in order of decoding.

    Attributes
    ----------
    offset, size : (n,) bytes in the file. lasts, late : (n,) how long each is decoded, and how much later it is shown,
        in units of the track's own clock. sync : (m,) numbers of those at which a decoder can begin.
    """

    path: Path
    offset: _Counts
    size: _Counts
    lasts: _Counts
    late: _Counts
    sync: _Counts
    _ftyp: bytes
    _mvhd: bytes
    _track: _Boxes
    _media: _Boxes
    _information: _Boxes
    _description: bytes

    def cuts(self) -> _Counts:
        """Return the numbers (k,) of the samples at which a part can begin; the first is 0."""
        shown = np.cumsum(self.lasts) - self.lasts + self.late
        latest_before = np.concatenate([[np.iinfo(np.int64).min], np.maximum.accumulate(shown)[:-1]])
        earliest_after = np.minimum.accumulate(shown[::-1])[::-1]
        clean = (latest_before < shown) & (earliest_after == shown)
        return self.sync[clean[self.sync]]

    def parts(self, most_bytes: int) -> list[slice]:
        """Return stretches of samples of ``most_bytes``, or of one cut to the next where that is more."""
        cuts = [*self.cuts().tolist(), len(self.size)]
        before = np.concatenate([[0], np.cumsum(self.size)])
        parts, first = [], cuts[0]
        for last, following in pairwise(cuts):
            if before[following] - before[first] > most_bytes and last > first:
                parts.append(slice(first, last))
                first = last
        return [*parts, slice(first, cuts[-1])]

    def file(self, part: slice) -> bytes:
        """Return a stretch of samples as an MP4 file."""
        size, lasts = self.size[part], self.lasts[part]
        ticks = int(lasts.sum())
        scale, movie_scale = (_timescale(head) for head in (self._media[b"mdhd"], self._mvhd))
        shown = ticks * movie_scale // max(scale, 1)
        head = _box(b"ftyp", self._ftyp)
        # where the samples begin is known once the tables before them are written, and written as long in any case
        start = len(head) + len(self._moov(part, 0, ticks, shown)) + _HEAD_64
        moov = self._moov(part, start, ticks, shown)
        content = [head, moov, struct.pack(">I4sQ", 1, b"mdat", _HEAD_64 + int(size.sum()))]
        with self.path.open("rb") as file:
            for place, count in zip(self.offset[part].tolist(), size.tolist(), strict=True):
                file.seek(place)
                content.append(file.read(count))
        return b"".join(content)

    def _moov(self, part: slice, start: int, ticks: int, shown: int) -> bytes:
        """Return the description of a part whose samples begin at byte ``start``."""
        late, size = self.late[part], self.size[part]
        sync = self.sync[(self.sync >= part.start) & (self.sync < part.stop)] - part.start + 1
        tables = [
            _box(b"stsd", self._description),
            _table(b"stts", *_runs(self.lasts[part])),
            *([_table(b"ctts", *_runs(late), version=1)] if late.any() else []),
            _table(b"stss", sync),
            _table(b"stsc", np.ones(1), np.full(1, len(size)), np.ones(1)),
            _box(b"stsz", struct.pack(">III", 0, 0, len(size)) + size.astype(">u4").tobytes()),
            _table(b"stco", np.full(1, start)),
        ]
        information = [_box(kind, body) for kind, body in self._information.items() if kind != b"stbl"]
        media = [
            _box(b"mdhd", _with_duration(self._media[b"mdhd"], ticks, _MEDIA_DURATION)),
            _box(b"hdlr", self._media[b"hdlr"]),
            _box(b"minf", b"".join([*information, _box(b"stbl", b"".join(tables))])),
        ]
        track = [
            _box(b"tkhd", _with_duration(self._track[b"tkhd"], shown, _TRACK_DURATION)),
            _box(b"mdia", b"".join(media)),
        ]
        movie = _box(b"mvhd", _with_duration(self._mvhd, shown, _MEDIA_DURATION))
        return _box(b"moov", movie + _box(b"trak", b"".join(track)))


# of an `mdat` with a length of 64 bits
_HEAD_64 = 16
# where the duration stands, of version 0 and 1
_MEDIA_DURATION, _TRACK_DURATION = (16, 24), (20, 28)


def mp4_samples(path: Path) -> Mp4Samples:
    """Read the tables of a file that `mp4_fault` finds no fault with; raises `SessionError` where it cannot be cut."""
    try:
        ftyp, moov = mp4_moov(path)
        movie = dict(mp4_boxes(moov, b"moov"))
        tracks = [dict(mp4_boxes(body, kind)) for kind, body in mp4_boxes(moov, b"moov") if kind == b"trak"]
        videos = [(t, m) for t in tracks if (m := dict(mp4_boxes(t[b"mdia"], b"mdia")))[b"hdlr"][8:12] == b"vide"]
        if len(videos) != 1 or b"mvex" in movie:
            raise SessionError(str(path), got=f"{len(videos)} tracks, or in fragments", wanted="one track of video")
        ((track, media),) = videos
        information = dict(mp4_boxes(media[b"minf"], b"minf"))
        tables = dict(mp4_boxes(information[b"stbl"], b"stbl"))
        size = _sizes(tables[b"stsz"])
        count, late = len(size), np.zeros(len(size), dtype=np.int64)
        if b"ctts" in tables:
            late = _spread(tables[b"ctts"], ">i4" if tables[b"ctts"][0] else ">u4")
        return Mp4Samples(
            path=path,
            offset=_offsets(tables, size),
            size=size,
            lasts=_same_length(_spread(tables[b"stts"], ">u4"), count),
            late=_same_length(late, count),
            sync=_entries(tables[b"stss"], 1)[:, 0] - 1 if b"stss" in tables else np.arange(count),
            _ftyp=ftyp,
            _mvhd=movie[b"mvhd"],
            _track=track,
            _media=media,
            _information=information,
            _description=tables[b"stsd"],
        )
    except (KeyError, IndexError, ValueError, struct.error) as fault:
        raise SessionError(str(path), got=f"tables that do not fit ({fault})", wanted="an MP4 video") from fault


def _offsets(tables: _Boxes, size: _Counts) -> _Counts:
    """Return each sample's place (n,) in the file: chunks by `stsc`, within a chunk one behind the other."""
    chunks = (_entries(tables[b"stco"], 1) if b"stco" in tables else _entries(tables[b"co64"], 1, ">u8"))[:, 0]
    runs = _entries(tables[b"stsc"], 3)
    if len(runs) == 0 or runs[0, 0] != 1 or runs[-1, 0] > len(chunks) or np.any(runs[:, 1] < 1):
        raise ValueError("stsc")
    per_chunk = np.repeat(runs[:, 1], np.diff([*runs[:, 0].tolist(), len(chunks) + 1]))
    first = np.cumsum(per_chunk) - per_chunk
    if int(per_chunk.sum()) != len(size):
        raise ValueError("stsc")
    before = np.cumsum(size) - size
    return np.asarray(np.repeat(chunks - before[first], per_chunk) + before, dtype=np.int64)


def _sizes(body: bytes) -> _Counts:
    same, count = struct.unpack(">II", body[4:12])
    if same:
        return np.full(count, same, dtype=np.int64)
    return np.frombuffer(body, ">u4", count, 12).astype(np.int64)


def _entries(body: bytes, columns: int, kind: str = ">u4") -> _Counts:
    (count,) = struct.unpack(">I", body[4:8])
    return np.frombuffer(body, kind, columns * count, 8).reshape(-1, columns).astype(np.int64)


def _spread(body: bytes, kind: str) -> _Counts:
    """Return the value of each sample of a table of runs."""
    (count,) = struct.unpack(">I", body[4:8])
    rows = np.frombuffer(body, np.dtype([("n", ">u4"), ("value", kind)]), count, 8)
    return np.repeat(rows["value"].astype(np.int64), rows["n"].astype(np.int64))


def _same_length(values: _Counts, count: int) -> _Counts:
    if len(values) != count:
        raise ValueError(f"{len(values)} times of {count} samples")
    return values


def _runs(values: _Counts) -> Iterator[_Counts]:
    """Return lengths and values of the runs of equal values."""
    first = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    yield np.diff([*first.tolist(), len(values)])
    yield values[first]


def _table(kind: bytes, *columns: NDArray[np.generic], version: int = 0) -> bytes:
    rows = np.stack(columns, axis=1)
    return _box(kind, struct.pack(">B3xI", version, len(rows)) + rows.astype(">i4").tobytes())


def _timescale(head: bytes) -> int:
    return int(struct.unpack_from(">I", head, 20 if head[0] else 12)[0])


def _with_duration(head: bytes, duration: int, place: tuple[int, int]) -> bytes:
    at, kind = (place[1], ">Q") if head[0] else (place[0], ">I")
    number = struct.pack(kind, duration)
    return head[:at] + number + head[at + len(number) :]


def _box(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(body), kind) + body
