"""Whether bytes are a complete PNG, by its chunks, checked before a decoder allocates memory for their sizes."""

import struct

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_MAX_CHUNKS = 100_000


def png_size_px(data: bytes) -> tuple[int, int] | None:
    """Return width and height of a PNG, or None where the bytes are not a PNG or are truncated.

    Only the positions of the chunks are read (PNG specification, third edition, §5), not their contents: for a chunk
    longer than its file a decoder first allocates its whole length, and may return half a picture.
    """
    if not data.startswith(PNG_SIGNATURE) or data[12:16] != b"IHDR" or len(data) < 33:
        return None
    width, height = struct.unpack(">II", data[16:24])
    at = len(PNG_SIGNATURE)
    for _ in range(_MAX_CHUNKS):
        if at + 12 > len(data):
            return None
        (length,) = struct.unpack_from(">I", data, at)
        kind = data[at + 4 : at + 8]
        at += 12 + length
        if kind == b"IEND":
            return (width, height) if at <= len(data) else None
    return None
