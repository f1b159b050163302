"""A long video as several: the same samples and pictures, each frame in its own part, and again below a run's name."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun as rr

from groundstation.errors import SessionError
from groundstation.replay.view import ViewRequest, prepare_view
from groundstation.session import load_session
from groundstation.sinks.mp4_parts import Mp4Samples, mp4_samples
from groundstation.sinks.mp4_tables import mp4_fault
from groundstation.viewer import media as rerun_media
from groundstation.viewer.merge_recordings import RunAlignment
from groundstation.viewer.session_recording import write_session_recording
from tests.session.folder import write_video
from tests.viewer.recording import Recording

LANDING = Path(__file__).resolve().parents[2] / "recordings" / "landing-1"
# a decoder can begin at two frames of it; it has frames that are shown in another order than decoded
VIDEO, FRAMES, KEY_FRAME = LANDING / "left.mp4", 332, 250


@pytest.fixture(scope="module")
def samples() -> Mp4Samples:
    return mp4_samples(VIDEO)


def test_a_part_contains_its_samples_unchanged_with_their_times(samples: Mp4Samples, tmp_path: Path) -> None:
    assert samples.late.any()
    assert samples.cuts().tolist() == [0, KEY_FRAME]
    whole, times = VIDEO.read_bytes(), []
    whole_ns = rr.AssetVideo(path=VIDEO).read_frame_timestamps_nanos()
    for number, part in enumerate(samples.parts(1_000_000)):
        path = tmp_path / f"{number}.mp4"
        path.write_bytes(samples.file(part))
        assert mp4_fault(path) == ""
        again = mp4_samples(path)
        for at, size, was in zip(again.offset, again.size, samples.offset[part], strict=True):
            assert path.read_bytes()[at : at + size] == whole[was : was + size]
        np.testing.assert_array_equal(again.late, samples.late[part])
        times.append(rr.AssetVideo(path=path).read_frame_timestamps_nanos())
    assert [len(t) for t in times] == [KEY_FRAME, FRAMES - KEY_FRAME]
    np.testing.assert_array_equal(np.diff(times[1]), np.diff(whole_ns[KEY_FRAME:]))


def test_a_decoder_finds_the_pictures_in_it(samples: Mp4Samples, tmp_path: Path) -> None:
    """Expected: those of the whole video; of the last part, which is far in, pictures that follow on one another."""
    whole = cv2.VideoCapture(str(VIDEO))
    for number, part in enumerate(samples.parts(1_000_000)):
        path = tmp_path / f"{number}.mp4"
        path.write_bytes(samples.file(part))
        capture = cv2.VideoCapture(str(path))
        first, second = (capture.read()[1].astype(float) for _ in range(2))
        assert 0.0 < np.abs(second - first).mean() < 5.0
        if not number:
            np.testing.assert_array_equal(first, whole.read()[1])


def test_parts_have_the_requested_size(samples: Mp4Samples) -> None:
    even = replace(samples, size=np.full(FRAMES, 100), sync=np.arange(0, FRAMES, 10), late=np.zeros(FRAMES, np.int64))
    assert [p.stop - p.start for p in even.parts(12_000)] == [120, 120, 92]
    # what lies between two cuts stays together
    assert {p.stop - p.start for p in even.parts(10)} == {10, 2}
    assert even.parts(100 * FRAMES) == [slice(0, FRAMES)]


def test_no_cut_is_where_a_later_sample_is_shown_earlier(samples: Mp4Samples) -> None:
    """Expected: an open group of pictures, whose first leads to pictures shown before it, does not begin a part."""
    late = samples.late.copy()
    late[KEY_FRAME] += 10 * samples.lasts[KEY_FRAME]
    assert replace(samples, late=late).cuts().tolist() == [0]


def test_a_file_without_a_video_track_or_with_torn_tables_is_a_project_error(tmp_path: Path) -> None:
    (tmp_path / "none.mp4").write_bytes(b"\0\0\0\x10ftypisom\0\0\0\0")
    with pytest.raises(SessionError, match=r"none\.mp4"):
        mp4_samples(tmp_path / "none.mp4")
    write_video(tmp_path / "own.mp4", range(4), "mp4v")
    content = (tmp_path / "own.mp4").read_bytes()
    (tmp_path / "torn.mp4").write_bytes(content.replace(b"stts", b"free"))
    with pytest.raises(SessionError, match=r"torn\.mp4"):
        mp4_samples(tmp_path / "torn.mp4")


def test_each_frame_refers_to_its_part_also_beside_another_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rerun_media, "PART_BYTES", 1_000_000)
    session, path = load_session(LANDING), tmp_path / "parts.rrd"
    assert "pictures of left and right" in write_session_recording(session, path)
    made = prepare_view(ViewRequest(sources=(path, path), work=tmp_path / "work", align=RunAlignment.START))
    for run, recording in (("", Recording(path)), (f"/{made.names[1]}", Recording(made.recording))):
        image = f"{run}/cameras/left/image"
        parts = [f"{image}/part/{k:04d}" for k in (0, 1)]
        found = recording.column(image, "VideoFrameReference:video_reference")
        assert found == [[parts[0]]] * KEY_FRAME + [[parts[1]]] * (FRAMES - KEY_FRAME)
        stamps = [row[0] for row in recording.column(image, "VideoFrameReference:timestamp")]  # type: ignore[index]
        assert stamps == [100_000_000 * k for k in (*range(KEY_FRAME), *range(FRAMES - KEY_FRAME))]
        for part in parts:
            assert sum("AssetVideo:blob" in rows.schema.names for rows in recording.static[part]) == 1
