"""Pictures read in parts: the same pixels whole, in windows, and from recorded parts."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.box import Box, box_of_size, clip, expand
from groundstation.picture import (
    BayerPattern,
    BgrPicture,
    PartialPicture,
    Picture,
    PictureError,
    RawPicture,
)

SIZE = (48, 34)
RNG = np.random.default_rng(11)
RAW = RNG.integers(0, 256, (SIZE[1], SIZE[0])).astype(np.uint8)
BGR = RNG.integers(0, 256, (SIZE[1], SIZE[0], 3)).astype(np.uint8)

windows = st.tuples(
    st.integers(-10, SIZE[0] + 5), st.integers(-10, SIZE[1] + 5), st.integers(1, 60), st.integers(1, 60)
).map(lambda b: box_of_size(*b))
kinds = st.sampled_from(["bgr", "grey", *BayerPattern])


def picture_of(kind: str) -> Picture:
    if kind == "bgr":
        return BgrPicture(BGR)
    return RawPicture(RAW, None if kind == "grey" else BayerPattern(kind))


def pattern_of(kind: str) -> BayerPattern | None:
    return BayerPattern(kind) if kind in set(BayerPattern) else None


@given(windows, kinds)
def test_a_window_equals_that_part_of_the_whole(window: Box[int], kind: str) -> None:
    inside = clip(window, SIZE)
    if inside is None:
        with pytest.raises(PictureError, match="no part of it is inside"):
            picture_of(kind).window(window)
        return
    pixels, corner = picture_of(kind).window(window)
    assert corner == inside[:2]
    whole = picture_of(kind).whole()
    np.testing.assert_array_equal(pixels, whole[inside[1] : inside[3], inside[0] : inside[2]])


@given(windows, windows, kinds)
def test_what_was_kept_shows_the_same_again(first: Box[int], second: Box[int], kind: str) -> None:
    seen = picture_of(kind)
    shown = [seen.window(w) for w in (first, second) if clip(w, SIZE) is not None]
    again = PartialPicture(SIZE, [seen.recordable(w) for w in seen.read], pattern_of(kind))
    for window, (pixels, corner) in zip([w for w in (first, second) if clip(w, SIZE) is not None], shown, strict=True):
        repeated, there = again.window(window)
        assert there == corner
        np.testing.assert_array_equal(repeated, pixels)
    if shown:
        pixels, (x, y) = shown[-1]
        glance = again.preview()
        assert glance.shape == (SIZE[1], SIZE[0], 3)
        np.testing.assert_array_equal(glance[y : y + pixels.shape[0], x : x + pixels.shape[1]], pixels)


def test_what_was_not_kept_is_an_error_and_never_black() -> None:
    seen = BgrPicture(BGR)
    seen.window(Box(4, 4, 12, 12))
    again = PartialPicture(SIZE, [seen.recordable(w) for w in seen.read], None)
    with pytest.raises(PictureError, match=r"window \(4, 4, 13, 12\) .* it holds 8×8 at \(4, 4\)"):
        again.window(Box(4, 4, 13, 12))
    with pytest.raises(PictureError):
        again.whole()


@given(windows, windows, windows, kinds)
def test_available_pixels_can_be_read(first: Box[int], second: Box[int], wanted: Box[int], kind: str) -> None:
    """Expected: all of a window that was read; of any other window a part, and that part's own pixels."""
    seen = picture_of(kind)
    read = [w for w in (first, second) if clip(w, SIZE) is not None]
    for window in read:
        seen.window(window)
    again = PartialPicture(SIZE, [seen.recordable(w) for w in seen.read], pattern_of(kind))
    for window in read:
        assert again.available(window) == clip(window, SIZE) == seen.available(window)
    part = again.available(wanted)
    if part is not None:
        assert clip(part, SIZE) == part
        np.testing.assert_array_equal(again.window(part)[0], seen.window(part)[0])
        assert (max(part[0], wanted[0]), max(part[1], wanted[1])) == part[:2]
        assert (min(part[2], wanted[2]), min(part[3], wanted[3])) == part[2:]


def test_what_was_read_is_noted() -> None:
    picture = BgrPicture(BGR)
    picture.window(Box(-5, 2, 9, 9))
    assert picture.read == [(0, 2, 9, 9)]
    assert not picture.whole_read
    picture.whole()
    assert picture.whole_read


def test_the_patterns_are_those_of_the_cameras() -> None:
    for pattern, (row, column) in {
        BayerPattern.RG: (0, 0),
        BayerPattern.GR: (0, 1),
        BayerPattern.GB: (1, 0),
        BayerPattern.BG: (1, 1),
    }.items():
        # only the red pixels see anything: the picture is red
        raw = np.zeros((16, 16), np.uint8)
        raw[row::2, column::2] = 200
        blue, green, red = (float(v) for v in cv2.mean(RawPicture(raw, pattern).whole()[4:12, 4:12])[:3])
        assert (blue, green, red) == (0.0, 0.0, 200.0), pattern


def test_a_grown_window_may_reach_beyond() -> None:
    assert clip(expand(Box(0, 30, 10, 34), 3), SIZE) == (0, 27, 13, 34)
