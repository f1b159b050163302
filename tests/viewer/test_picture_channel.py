"""Pictures one by one, where Rerun cannot take a station's video in one piece."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.messages import CameraReport, DetectionStatus, Frame, Miss, MissReason, StepReport
from groundstation.picture import BgrPicture
from groundstation.session import load_session
from groundstation.sources.folder_source import FolderSource
from groundstation.viewer import media as rerun_media
from groundstation.viewer import picture_channel as rerun_pictures
from groundstation.viewer.session_recording import write_session_recording
from groundstation.viewer.session_view import session_view
from tests.session.folder import Tiny, number_of, picture, write_pictures, write_video
from tests.viewer.recording import Recording

IMAGE = "/cameras/left/image"
ROWS = 12


def numbers_shown(recording: Recording) -> list[int]:
    """The number that each picture of the left camera carries in its stripes."""
    blobs = [bytes(row[0]) for row in recording.column(IMAGE, "EncodedImage:blob")]  # type: ignore[index]
    return [number_of(cv2.imdecode(np.frombuffer(blob, np.uint8), cv2.IMREAD_COLOR)) for blob in blobs]  # type: ignore[arg-type]


def seen(session: Path, out: Path, *, wanted: bool = True) -> Recording:
    """The recording of a run over a session whose reports carry the pictures if they are wanted."""
    view = session_view(out, load_session(session))
    assert view.wants_pictures is wanted
    for k in range(ROWS):
        report = CameraReport(
            t_s=1.0 + 0.1 * k,
            station="left",
            epoch=k,
            status=DetectionStatus.MISS,
            result=Miss(reason=MissReason.NOT_ACQUIRED, detail=""),
            roi=None,
            predicted_px=None,
            predicted_covariance_px2=None,
            pan_rad=None,
            tilt_rad=None,
            innovation=None,
            elapsed_s=0.0,
            image=BgrPicture(picture(k)) if wanted else None,
        )
        view.write(StepReport(cameras=(report, replace(report, station="right"))))
    view.close()
    return Recording(out)


@pytest.mark.parametrize(("kind", "suffix"), [("MJPG", ".avi"), ("FFV1", ".mkv"), ("mp4v", ".mp4")])
def test_a_video_that_rerun_cannot_read_is_shown_picture_by_picture(tmp_path: Path, kind: str, suffix: str) -> None:
    folder = Tiny(video="none", rows=ROWS).write(tmp_path / "session")
    for name in ("left", "right"):
        write_video(folder / f"{name}{suffix}", range(ROWS), kind)
    recording = seen(folder, tmp_path / "session.rrd")
    assert numbers_shown(recording) == list(range(ROWS))
    assert recording.times_ns(IMAGE) == [1_000_000_000 + 100_000_000 * k for k in range(ROWS)]


def test_a_video_too_large_between_key_frames_is_shown_picture_by_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    landing = Path(__file__).resolve().parents[2] / "recordings" / "landing-1"
    assert not session_view(tmp_path / "a.rrd", load_session(landing)).wants_pictures
    monkeypatch.setattr(rerun_media, "PART_BYTES", 1_000_000)
    assert not session_view(tmp_path / "parts.rrd", load_session(landing)).wants_pictures
    monkeypatch.setattr(rerun_media, "MAX_VIDEO_BYTES", 1_000_000)
    assert session_view(tmp_path / "b.rrd", load_session(landing)).wants_pictures


def test_of_a_long_session_each_nth_picture_is_shown_and_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Tiny(rows=ROWS).write(tmp_path / "session")
    first = len(rerun_pictures.jpeg_bytes(picture(0)))
    monkeypatch.setattr(rerun_pictures, "MAX_PICTURE_BYTES", round(1.5 * first * ROWS / 3) + 1)
    recording = seen(folder, tmp_path / "session.rrd")
    assert numbers_shown(recording) == [0, 3, 6, 9]
    assert f"one picture in 3 of left: there are {ROWS}" in recording.text("/log/track")


def test_a_folder_too_large_is_thinned_by_its_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Tiny(rows=ROWS, video="png").write(tmp_path / "session")
    size = sum(path.stat().st_size for path in (folder / "left").iterdir())
    monkeypatch.setattr(rerun_pictures, "MAX_PICTURE_BYTES", size // 2 + 1)
    recording = seen(folder, tmp_path / "session.rrd", wanted=False)
    assert numbers_shown(recording) == [0, 2, 4, 6, 8, 10]


def test_pictures_are_those_that_the_detector_got_where_a_camera_counts_by_itself(tmp_path: Path) -> None:
    """Expected: the left camera began 3 frames before the pairs, and lacks one: pictures 3, 4, 6, … of its folder."""
    folder = Tiny(rows=ROWS, video="none").write(tmp_path / "session")
    write_pictures(folder / "left", range(ROWS + 3))
    write_pictures(folder / "right", range(ROWS))
    rows = [f"{k},{1 + 0.1 * k},{1 + 0.1 * k},{k + 3},{k}" for k in range(ROWS)]
    rows[2] = "2,,1.2,,2"
    (folder / "frames.csv").write_text("\n".join(["index,left_t_s,right_t_s,left_index,right_index", *rows]) + "\n")
    with FolderSource(load_session(folder)) as source:
        looked_at = [e for e in source if isinstance(e, Frame) and e.station == "left"]
    recording = seen(folder, tmp_path / "session.rrd", wanted=False)
    assert numbers_shown(recording) == [number_of(frame.image.whole()) for frame in looked_at] == [3, 4, *range(6, 15)]


def test_a_folder_of_another_kind_is_sent_with_the_reports(tmp_path: Path) -> None:
    folder = Tiny(rows=ROWS, video="none").write(tmp_path / "session")
    for name in ("left", "right"):
        write_pictures(folder / name, range(ROWS))
        for path in (folder / name).iterdir():
            image = cv2.imread(str(path))
            assert image is not None
            cv2.imwrite(str(path.with_suffix(".bmp")), image)
            path.unlink()
    assert numbers_shown(seen(folder, tmp_path / "session.rrd")) == list(range(ROWS))


def test_pieces_are_sent_when_full(tmp_path: Path) -> None:
    channel = rerun_pictures.PictureChannel("left")
    noisy = np.random.default_rng(3).integers(0, 255, (960, 1280, 3), dtype=np.uint8)
    count = 0
    while not channel.full:
        channel.add_picture(0.1 * count, count, noisy)
        count += 1
    (batch,) = channel.take()
    assert len(batch.t_s) == count < 20
    assert not channel.full
    assert channel.take() == []


@pytest.mark.parametrize("video", ["avi", "png"])
def test_a_session_that_is_not_replayed_shows_them_as_well(tmp_path: Path, video: str) -> None:
    folder = Tiny(rows=ROWS, video=video).write(tmp_path / "session")
    shown = write_session_recording(load_session(folder), tmp_path / "session.rrd")
    assert shown == ("pictures of left and right",)
    recording = Recording(tmp_path / "session.rrd")
    assert numbers_shown(recording) == list(range(ROWS))
