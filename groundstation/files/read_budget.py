"""Limits of the data decoded from a recording: compressed, a small file can hold a thousand times its own size.

Each limit is a constant plus a multiple of the file's size, so that a long flight is read whole and a file that would
fill the memory or take hours is refused. The multiples exceed the needs of any recording (docs/formats.md).
"""

from dataclasses import dataclass

from groundstation.errors import RecordingError

_MIB = 2**20
# LZ4 compresses at most 255 to 1, and a black picture nearly reaches that
_UNPACKED_BYTES, _UNPACKED_RATIO = 64 * _MIB, 256
# a reading that repeats, packed with its head, takes about 30
_RECORDS, _BYTES_A_RECORD = 50_000, 12
# schemas and channels: those of this program take 20 kB once
_ANNOUNCED_BYTES, _ANNOUNCED_RATIO = 4 * _MIB, 0.25
# lines of JSON pack 6 to 1
_LINE_BYTES, _LINE_RATIO = 16 * _MIB, 16
# an even sky without noise has 100 pixels to the byte of PNG
_PIXELS, _PIXEL_RATIO = 128_000_000, 256
# the longest that the recorder writes, a frame of 64 parts, has 6 kB
MAX_LINE_BYTES = 65_536


@dataclass(slots=True)
class ReadBudget:
    """The use of the limits in one reading of a file of ``file_bytes``; ``where`` names the file.

    Each method counts an item before memory is allocated for it, and raises `RecordingError` beyond the limit.
    """

    where: str
    file_bytes: int
    unpacked_bytes: int = 0
    records: int = 0
    announced_bytes: int = 0
    line_bytes: int = 0
    pixels: int = 0

    def unpack(self, size: int) -> None:
        """Count a chunk that unpacks to ``size`` bytes."""
        self.unpacked_bytes += size
        self._check(self.unpacked_bytes, _UNPACKED_BYTES + _UNPACKED_RATIO * self.file_bytes, "bytes, unpacked")

    def record(self) -> None:
        """Count a record in a chunk."""
        self.records += 1
        self._check(self.records, _RECORDS + self.file_bytes // _BYTES_A_RECORD, "records")

    def announce(self, size: int) -> None:
        """Count a schema or a channel of ``size`` bytes."""
        self.announced_bytes += size
        most = _ANNOUNCED_BYTES + int(_ANNOUNCED_RATIO * self.file_bytes)
        self._check(self.announced_bytes, most, "bytes of schemas and channels")

    def line(self, size: int) -> None:
        """Count a line of JSON of ``size`` bytes."""
        if size > MAX_LINE_BYTES:
            got = f"an event of {size} bytes"
            raise RecordingError(self.where, got=got, wanted=f"at most {MAX_LINE_BYTES}")
        self.line_bytes += size
        self._check(self.line_bytes, _LINE_BYTES + _LINE_RATIO * self.file_bytes, "bytes of events")

    def decode(self, pixels: int) -> None:
        """Count a picture of so many pixels."""
        self.pixels += pixels
        self._check(self.pixels, _PIXELS + _PIXEL_RATIO * self.file_bytes, "pixels")

    def _check(self, found: int, most: int, what: str) -> None:
        if found > most:
            got = f"more than {most} {what} in a file of {self.file_bytes} bytes"
            raise RecordingError(self.where, got=got, wanted="a recording, not a file made to fill the memory")
