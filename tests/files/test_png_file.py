"""A PNG is complete or refused, before a decoder allocates memory for its stated size."""

import struct
import zlib

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from groundstation.files.png_file import png_size_px

PICTURE = np.random.default_rng(3).integers(0, 256, (30, 50, 3), dtype=np.uint8)
PNG = cv2.imencode(".png", PICTURE)[1].tobytes()


def test_what_a_writer_wrote_is_whole_whatever_follows_it() -> None:
    assert png_size_px(PNG) == (50, 30)
    assert png_size_px(PNG + b"and more") == (50, 30)


@given(st.integers(0, len(PNG) - 1))
def test_cut_anywhere_it_is_none(length: int) -> None:
    assert png_size_px(PNG[:length]) is None


def test_a_chunk_longer_than_its_file_is_none() -> None:
    at = PNG.index(b"IDAT") - 4
    assert png_size_px(PNG[:at] + struct.pack(">I", 2**31 - 1) + PNG[at + 4 :]) is None


def test_a_file_of_only_chunks_ends() -> None:
    empty = struct.pack(">I", 0) + b"teXt" + struct.pack(">I", zlib.crc32(b"teXt"))
    assert png_size_px(PNG[:33] + empty * 100_001 + PNG[33:]) is None


@given(st.binary(max_size=200))
def test_other_bytes_are_none(data: bytes) -> None:
    assert png_size_px(PNG[:33] + data) is None or b"IEND" in data
