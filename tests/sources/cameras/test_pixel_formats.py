"""What cameras send, as pictures: raw stays raw, colours come in OpenCV's order, padding and depth go."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.picture import BayerPattern, BgrPicture, RawPicture
from groundstation.sources.cameras.camera import CameraError
from groundstation.sources.cameras.pixel_formats import picture_of, pixels_of


@given(
    w=st.integers(1, 20), h=st.integers(1, 20), padding=st.integers(0, 5), tail=st.integers(0, 7), short=st.booleans()
)
def test_rows_lose_their_padding(w: int, h: int, padding: int, tail: int, short: bool) -> None:
    rows = np.random.default_rng(w * 100 + h).integers(0, 256, (h, w + padding), dtype=np.uint8)
    sent = rows.reshape(-1)[: rows.size - (padding if short else 0)]
    sent = np.concatenate([sent, np.zeros(0 if short else tail, np.uint8)])
    got = pixels_of(sent, "BayerGB8", (w, h), padding)
    assert np.array_equal(got.pixels, rows[:, :w])
    assert got.pattern is BayerPattern.GB
    assert got.pixels.flags.c_contiguous
    assert not np.shares_memory(got.pixels, sent)


@pytest.mark.parametrize(("name", "bits"), [("Mono10", 10), ("Mono12", 12), ("BayerRG12", 12), ("BayerBG16", 16)])
def test_deep_pixels_keep_their_upper_eight_bits(name: str, bits: int) -> None:
    sent = np.array([[0, 2**bits - 1], [2 ** (bits - 1), 2 ** (bits - 8)]], np.uint16)
    assert pixels_of(sent, name, (2, 2)).pixels.tolist() == [[0, 255], [128, 1]]


@pytest.mark.parametrize(
    ("name", "sent"), [("RGB8", [1, 2, 3]), ("BGR8", [3, 2, 1]), ("RGBa8", [1, 2, 3, 9]), ("BGRa8", [3, 2, 1, 9])]
)
def test_colours_are_in_opencvs_order(name: str, sent: list[int]) -> None:
    got = pixels_of(np.array(sent * 4, np.uint8), name, (2, 2))
    assert np.all(got.pixels == [3, 2, 1])
    assert isinstance(picture_of(got.pixels, got.pattern), BgrPicture)


def test_raw_pixels_become_a_raw_picture() -> None:
    got = pixels_of(np.zeros(16, np.uint8), "BayerRG8", (4, 4))
    assert isinstance(picture_of(got.pixels, got.pattern), RawPicture)


@pytest.mark.parametrize("name", ["Mono12p", "BayerRG10Packed", "YUV422_8", "Mono9", "", "Coord3D_C16"])
def test_other_formats_are_refused_by_name(name: str) -> None:
    with pytest.raises(CameraError, match="wanted Mono8"):
        pixels_of(np.zeros(100, np.uint8), name, (4, 4))


def test_too_few_values_are_refused() -> None:
    with pytest.raises(CameraError, match="got 47 values; wanted 48"):
        pixels_of(np.zeros(47, np.uint8), "RGB8", (4, 4))
