"""The size in the header of a coded picture, checked before a decoder allocates memory for it.

Decoders trust the header: 100 kB of PNG can request a gigabyte. Only the formats recognised here are decoded.
"""

import re
import struct

from groundstation.files.png_file import PNG_SIGNATURE, png_size_px

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
# in colour 78 MB: with four copies in work it stays below the 512 MB that a file may cost; 6000 × 4000 px go in
MAX_PICTURE_PX = 26_000_000
# each scan of a progressive JPEG covers the whole picture; encoders write about ten
_MAX_SCANS = 100
_MAX_JPEG_SEGMENTS = 10_000
# baseline, extended and progressive, by Huffman's or arithmetic code; lossless and hierarchical ones are not read
_JPEG_FRAMES = frozenset({0xC0, 0xC1, 0xC2, 0xC9, 0xCA})
_JPEG_BARE = frozenset({0x01, *range(0xD0, 0xD9)})
_START_OF_SCAN = 0xDA
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257
_TIFF_NUMBERS = {3: "H", 4: "I"}
_PNM = re.compile(rb"P[2356](?:\s|#[^\n]*+\n)++(\d{1,9})(?:\s|#[^\n]*+\n)++(\d{1,9})\s")


def coded_size_px(data: bytes) -> tuple[int, int] | None:
    """Return width and height in the header of a PNG, JPEG, BMP, TIFF, WebP or PNM; None for other files.

    It is also None for a picture that is truncated in its structure, and for one whose decoding would take
    far longer than its size suggests.
    """
    try:
        if data.startswith(PNG_SIGNATURE):
            return png_size_px(data)
        if data.startswith(b"\xff\xd8"):
            return _jpeg(data)
        if data.startswith(b"BM"):
            width, height = struct.unpack_from("<ii", data, 18)
            return width, abs(height)
        if data[:4] in (b"II*\0", b"MM\0*"):
            return _tiff(data)
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp(data)
        match = _PNM.match(data)
        return None if match is None else (int(match[1]), int(match[2]))
    except struct.error:
        return None


def is_decodable(data: bytes) -> bool:
    """Return whether a coded picture is of a kind and a size that a decoder may be given."""
    size = coded_size_px(data)
    return size is not None and min(size) > 0 and size[0] * size[1] <= MAX_PICTURE_PX


def _jpeg(data: bytes) -> tuple[int, int] | None:
    """Return the size of a JPEG (ITU-T T.81, annex B)."""
    if data.count(b"\xff\xda") > _MAX_SCANS:
        return None
    at = 2
    size = None
    for _ in range(_MAX_JPEG_SEGMENTS):
        marker, kind = struct.unpack_from(">BB", data, at)
        if marker != 0xFF:
            return None
        if kind == 0xFF:
            # fill bytes may precede any marker
            at += 1
            continue
        if kind in _JPEG_BARE:
            at += 2
            continue
        if kind == _START_OF_SCAN:
            return size
        (length,) = struct.unpack_from(">H", data, at + 2)
        if kind in _JPEG_FRAMES:
            if size is not None:
                return None
            height, width = struct.unpack_from(">HH", data, at + 5)
            size = width, height
        at += 2 + length
    return None


def _tiff(data: bytes) -> tuple[int, int] | None:
    """Return the size of a TIFF's first picture (TIFF 6.0, section 2)."""
    order = "<" if data.startswith(b"II") else ">"
    (at,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, at)
    found: dict[int, int] = {}
    for number in range(count):
        tag, kind, values = struct.unpack_from(order + "HHI", data, at + 2 + 12 * number)
        if tag in (_TIFF_WIDTH, _TIFF_HEIGHT):
            if kind not in _TIFF_NUMBERS or values != 1 or tag in found:
                return None
            (found[tag],) = struct.unpack_from(order + _TIFF_NUMBERS[kind], data, at + 2 + 12 * number + 8)
    return (found[_TIFF_WIDTH], found[_TIFF_HEIGHT]) if len(found) == 2 else None


def _webp(data: bytes) -> tuple[int, int] | None:
    """Return the size of a WebP's canvas (RFC 9649)."""
    kind = data[12:16]
    if kind == b"VP8X":
        low_w, high_w, low_h, high_h = struct.unpack_from("<HBHB", data, 24)
        return 1 + low_w + (high_w << 16), 1 + low_h + (high_h << 16)
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None
