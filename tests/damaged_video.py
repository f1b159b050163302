"""A video as a bad card leaves it: some of its frames cannot be decoded."""

from pathlib import Path


def damage(video: Path, frames: range) -> None:
    """Overwrite the frames of these numbers in an AVI file."""
    content = bytearray(video.read_bytes())
    at = content.index(b"movi")
    for k in range(frames.stop):
        at = content.index(b"00dc", at) + 8
        length = int.from_bytes(content[at - 4 : at], "little")
        if k in frames:
            content[at : at + length] = bytes(length)
        at += length
    video.write_bytes(content)
