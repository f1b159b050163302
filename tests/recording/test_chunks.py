"""What is inside a chunk, when it is not what it should be; and the text that goes into records."""

import struct

import pytest

from groundstation.errors import RecordingError
from groundstation.files.read_budget import ReadBudget
from groundstation.recording.event_codec import _EventFields, line
from groundstation.recording.mcap_reader import _ChunkReader


@pytest.mark.parametrize("data", [b"\x05", b"\x05" + struct.pack("<Q", 100) + b"short", b"\x05" + bytes(8)])
def test_a_record_that_is_cut_short_is_named_with_its_place(data: bytes) -> None:
    inside = _ChunkReader(data, "flight.mcap: byte 7", {}, {}, ReadBudget(where="flight.mcap", file_bytes=len(data)))
    with pytest.raises(
        RecordingError, match=r"^flight\.mcap: byte 7: got a (record|message) cut short; wanted a whole"
    ):
        list(inside.messages(7))


def test_names_are_written_unchanged() -> None:
    assert line({"station": "links Süd", "t_s": 0.1}) == '{"station":"links Süd","t_s":0.1}'.encode()


def test_whole_numbers_are_read_as_seconds_like_all_others() -> None:
    parsed = _EventFields(
        {"n": 1, "kind": "ptu", "t_s": 3, "station": "left", "pan_rad": 0, "tilt_rad": 1}, {"left": (8, 8)}, "x"
    )
    event = parsed._event("ptu")
    assert [type(value) for value in (event.t_s, event.pan_rad, event.tilt_rad)] == [float] * 3
    for wrong in (True, "3", float("nan"), 1e300):
        with pytest.raises(RecordingError):
            parsed._number("t_s", wrong)
