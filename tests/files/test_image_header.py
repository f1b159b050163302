"""The size in a coded picture's header equals the decoder's, and no decoder gets one that is too large."""

import struct

import cv2
import numpy as np
import pytest

from groundstation.files.image_header import MAX_PICTURE_PX, coded_size_px, is_decodable
from groundstation.recording.mcap_reader import MAX_RECORD_BYTES
from groundstation.recording.recorder import RecorderConfig
from tests.hostile.bombs import bmp, jpeg, jpeg_scans, png

CODED = [
    (".png", []),
    (".jpg", []),
    (".jpg", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]),
    (".bmp", []),
    (".tif", []),
    (".webp", [cv2.IMWRITE_WEBP_QUALITY, 80]),
    (".webp", [cv2.IMWRITE_WEBP_QUALITY, 101]),
    (".pgm", []),
]


@pytest.mark.parametrize(("suffix", "flags"), CODED)
@pytest.mark.parametrize("size", [(1, 1), (37, 5), (640, 481)])
def test_what_opencv_writes_has_the_size_that_it_was_written_with(
    suffix: str, flags: list[int], size: tuple[int, int], rng: np.random.Generator
) -> None:
    channels = () if suffix == ".pgm" else (3,)
    image = rng.integers(0, 256, (size[1], size[0], *channels), dtype=np.uint8)
    data = cv2.imencode(suffix, image, flags)[1].tobytes()
    assert coded_size_px(data) == size
    assert is_decodable(data)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif", ".webp", ".pgm"])
def test_a_header_cut_anywhere_is_none_or_the_same(suffix: str) -> None:
    data = cv2.imencode(suffix, np.zeros((5, 37), np.uint8))[1].tobytes()
    for length in range(min(len(data), 400)):
        assert coded_size_px(data[:length]) in (None, (37, 5))


def test_what_is_too_large_or_of_another_kind_is_not_decoded() -> None:
    for data in (png(30_000, 30_000), jpeg(), jpeg_scans(), bmp(), b"", b"GIF89a" + bytes(100), b"\0" * 100):
        assert not is_decodable(data)
    width = MAX_PICTURE_PX // 1000
    whole = bytearray(png(8, 8))
    struct.pack_into(">II", whole, 16, width, 1000)
    assert is_decodable(bytes(whole))
    struct.pack_into(">II", whole, 16, width + 1, 1000)
    assert not is_decodable(bytes(whole))


def test_a_whole_picture_in_colour_and_a_chunk_can_be_read_again() -> None:
    """Expected: the recorder writes no chunk that the reader refuses, with a picture of the largest size in a rig."""
    assert RecorderConfig().chunk_bytes + 3 * MAX_PICTURE_PX + 65_536 < MAX_RECORD_BYTES
