"""Whether bytes are a whole PNG, told from its chunks before a decoder makes room for what they claim."""

import struct

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_MAX_CHUNKS = 100_000


def png_size_px(data: bytes) -> tuple[int, int] | None:
    """Return width and height of a PNG, or None where the bytes are none or end before it does.

    Only the chunks' places are looked at (PNG specification, third edition, §5), not what is in them: a decoder asked
    for a chunk that is longer than its file first makes room for all of it, and may give half a picture.
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
