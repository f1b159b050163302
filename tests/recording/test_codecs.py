"""Lines, windows and pixels of a recording: they read back as written, and invalid input is refused."""

import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.box import Box, box_of_size, contains
from groundstation.errors import RecordingError
from groundstation.messages import Epoch, Event, FilterReset, Frame, FrameAngles, Heartbeat, PixelMeasurement, PtuSample
from groundstation.picture import BayerPattern, BgrPicture
from groundstation.recording.event_codec import (
    DroppedNote,
    FrameHeader,
    LostNote,
    NumberedEvent,
    PartNote,
    PixelsNote,
    event_values,
    line,
    note_values,
    parse_line,
)
from groundstation.recording.image_codec import decode_image, encode_image
from groundstation.recording.window_merging import MAX_PARTS, merge_windows

SIZES = {"left": (64, 48), "right": (64, 48)}
numbers = st.floats(-1e9, 1e9, allow_nan=False)
sigmas = st.floats(1e-6, 1e6)
names = st.sampled_from(sorted(SIZES))
whole = st.integers(0, 2**40)
simple_events: st.SearchStrategy[Event] = st.one_of(
    st.builds(PtuSample, t_s=numbers, station=names, pan_rad=numbers, tilt_rad=numbers),
    st.builds(
        FrameAngles,
        t_s=numbers,
        station=names,
        pan_rad=numbers,
        tilt_rad=numbers,
        sigma_rad=sigmas,
        delay_s=st.just(0.0) | st.floats(-0.5, 0.5),
    ),
    st.builds(
        PixelMeasurement,
        t_s=numbers,
        station=names,
        epoch=whole,
        u_px=numbers,
        v_px=numbers,
        sigma_px=st.none() | st.tuples(sigmas, sigmas),
    ),
    st.builds(Epoch, t_s=numbers, epoch=whole, stations=st.lists(names, max_size=3).map(tuple)),
    st.builds(FilterReset, t_s=numbers, why=st.text(max_size=9), in_vain=st.booleans()),
    st.builds(Heartbeat, t_s=numbers),
)
parts = st.builds(PartNote, topic=st.text(max_size=9), x=whole, y=whole, w=whole, h=whole)
notes = st.one_of(
    st.builds(PixelsNote, of=whole, parts=st.lists(parts, max_size=4).map(tuple), colour=st.booleans()),
    st.builds(DroppedNote, of=whole, why=st.text(max_size=9)),
    st.builds(LostNote, first=whole, last=whole),
)
values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
keys = st.sampled_from(
    (
        *("n", "kind", "t_s", "station", "epoch", "stations", "size_px", "pattern"),
        *("of", "parts", "colour", "why", "position_runway_m", "sigma_m", "in_vain", "u_px", "v_px", "sigma_px"),
        *("pan_rad", "tilt_rad", "sigma_rad", "delay_s"),
    )
)
kinds = st.sampled_from(
    [
        "ptu",
        "frame angles",
        "frame",
        "pixel",
        "epoch",
        "reference",
        "heartbeat",
        "begun anew",
        "pixels",
        "dropped",
        "lost",
        "x",
    ]
)
windows = st.tuples(st.integers(0, 60), st.integers(0, 40), st.integers(1, 30), st.integers(1, 30)).map(
    lambda w: box_of_size(*w)
)


@given(simple_events, whole)
def test_events_are_read_back_bit_for_bit(event: Event, n: int) -> None:
    assert parse_line(line(event_values(n, event)), SIZES, "test") == NumberedEvent(n=n, event=event)


def frame_line(size_px: object) -> bytes:
    """The line of a frame of ``left``, of a size that is stated."""
    picture = BgrPicture(np.zeros((48, 64, 3), np.uint8))
    values = event_values(3, Frame(t_s=1.0, station="left", epoch=2, image=picture))
    return line({**values, "size_px": size_px})


@pytest.mark.parametrize("size_px", [(64, 48), (32, 24), (96, 72)])
def test_a_frame_of_another_size_than_in_the_rig_is_read_back(size_px: tuple[int, int]) -> None:
    """Expected: a camera in operation changed it, and the recording of that is replayed all the same."""
    head = FrameHeader(t_s=1.0, station="left", epoch=2, size_px=size_px, pattern=None)
    assert parse_line(frame_line(list(size_px)), SIZES, "test") == NumberedEvent(n=3, event=head)


@pytest.mark.parametrize("size_px", [None, [64], [64, 48, 1], [64, 0], [-64, 48], [64.5, 48], [True, 48], [6000, 5000]])
def test_a_size_that_no_picture_has_is_refused(size_px: object) -> None:
    with pytest.raises(RecordingError, match=r"size_px: got .*; wanted \[64, 48\] as in the rig, or another size"):
        parse_line(frame_line(size_px), SIZES, "test")


@given(notes)
def test_notes_are_read_back(note: PixelsNote | DroppedNote | LostNote) -> None:
    assert parse_line(line(note_values(note)), SIZES, "test") == note


@given(st.dictionaries(keys, values), kinds)
def test_other_lines_are_refused_with_one_error(given_values: dict[str, object], kind: str) -> None:
    with suppress(RecordingError):
        parse_line(line({**given_values, "kind": kind}), SIZES, "test")


@given(st.binary(max_size=40))
def test_bytes_that_are_no_line_are_refused(data: bytes) -> None:
    with pytest.raises(RecordingError):
        parse_line(data, SIZES, "test")


@given(st.lists(windows, max_size=20))
def test_each_window_lies_in_one_part(read: list[Box[int]]) -> None:
    kept = merge_windows(read)
    assert len(kept) <= MAX_PARTS
    for w in read:
        assert any(contains(k, w) for k in kept)
    if len(kept) > 1:
        area = sum(k.area for k in kept)
        assert area <= sum(w.area for w in read)


@pytest.mark.parametrize("png", [True, False])
@pytest.mark.parametrize("colour", [True, False])
def test_pixels_are_read_back(png: bool, colour: bool, rng: np.random.Generator) -> None:
    shape = (13, 7, 3) if colour else (13, 7)
    pixels = rng.integers(0, 256, shape, dtype=np.uint8)
    message = encode_image(pixels, png=png, pattern=BayerPattern.GB, stamp_ns=1, frame_id="left/camera")
    back = decode_image(message, png=png, size_px=(7, 13), colour=colour, where="test")
    np.testing.assert_array_equal(back, pixels)
    for size, other in (((13, 7), colour), ((7, 13), not colour)):
        with pytest.raises(RecordingError):
            decode_image(message, png=png, size_px=size, colour=other, where="test")


def test_a_picture_with_an_enormous_header_is_not_unpacked() -> None:
    pixels = np.zeros((13, 7), np.uint8)
    message = encode_image(pixels, png=True, pattern=None, stamp_ns=1, frame_id="left/camera")
    bomb = message.replace(struct.pack(">II", 7, 13), struct.pack(">II", 60_000, 60_000))
    assert bomb != message
    with pytest.raises(RecordingError, match="damaged"):
        decode_image(bomb, png=True, size_px=(7, 13), colour=False, where="test")


@given(st.binary(max_size=60), st.booleans())
def test_bytes_that_are_no_picture_are_refused(data: bytes, png: bool) -> None:
    with pytest.raises(RecordingError):
        decode_image(data, png=png, size_px=(7, 13), colour=False, where="test")
