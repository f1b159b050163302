"""Frame identity, threads and memory of the decoders."""

import itertools
import shutil
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from groundstation.errors import SessionError
from groundstation.session import Medium, MediumKind, load_session
from groundstation.sources import picture_reader
from groundstation.sources.folder_source import FolderSource
from groundstation.sources.picture_reader import QUEUE_FRAMES, SEEK_BEYOND, PictureReader
from groundstation.sources.video_seek import seek
from tests.session.folder import SIZE, Tiny, number_of, write_pictures, write_video


def reader(path: Path, indices: Sequence[int], size: tuple[int, int] = SIZE) -> PictureReader:
    kind = MediumKind.IMAGES if path.is_dir() else MediumKind.VIDEO
    wanted = np.array(indices, dtype=np.int64)
    return PictureReader(Medium(kind=kind, path=path), wanted, wanted + 2, size, whole=False)


def numbers(path: Path, indices: Sequence[int]) -> list[int]:
    """Return the numbers in the pixels, which must be those that the pictures claim."""
    found = []
    with reader(path, indices) as opened:
        while (picture := opened.next()) is not None:
            assert picture.image.shape == (SIZE[1], SIZE[0], 3)
            assert picture.image.dtype == np.uint8
            assert number_of(picture.image) == picture.index
            found.append(picture.index)
    return found


def decoders() -> list[str]:
    return [t.name for t in threading.enumerate() if t.name.startswith("decode-")]


# ---------------------------------------------------------------------------------------------- identity
@pytest.mark.parametrize("fourcc", ["MJPG", "mp4v"])
def test_each_picture_is_the_frame_of_its_number(tmp_path: Path, fourcc: str) -> None:
    path = tmp_path / ("v.avi" if fourcc == "MJPG" else "v.mp4")
    write_video(path, range(60), fourcc)
    assert numbers(path, range(60)) == list(range(60))
    assert numbers(path, [0, 1, 7, 30, 59]) == [0, 1, 7, 30, 59]


def test_grey_videos_and_grey_pictures_have_three_channels(tmp_path: Path) -> None:
    write_video(tmp_path / "v.avi", range(5), colour=False)
    assert numbers(tmp_path / "v.avi", range(5)) == list(range(5))
    write_pictures(tmp_path / "p", range(3))
    for path in (tmp_path / "p").iterdir():
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
    assert numbers(tmp_path / "p", range(3)) == [0, 1, 2]


def test_pictures_by_number_whatever_their_kind_and_width(tmp_path: Path) -> None:
    write_pictures(tmp_path / "p", [3, 12])
    (tmp_path / "p" / "000003.png").rename(tmp_path / "p" / "3.PNG")
    (tmp_path / "p" / "notes.txt").write_text("12")
    (tmp_path / "p" / "dark.png").write_bytes(b"")
    (tmp_path / "p" / "²³.png").write_bytes(b"")
    assert numbers(tmp_path / "p", [3, 12]) == [3, 12]


@pytest.mark.parametrize("name", ["v.avi", "v.mp4", "v.mkv"])
def test_identity_far_into_a_video(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a seek lands on the very frame, so that few frames are decoded before it."""
    write_video(tmp_path / name, range(600), "MJPG" if name == "v.avi" else "mp4v")
    landed = []
    monkeypatch.setattr(picture_reader, "seek", lambda *a: landed.append(seek(*a)) or landed[-1])
    for first in (SEEK_BEYOND, 217, 431, 598):
        assert numbers(tmp_path / name, [first, 599]) == [first, 599]
    assert landed == [True] * 4
    assert numbers(tmp_path / name, [SEEK_BEYOND - 1]) == [SEEK_BEYOND - 1]
    assert len(landed) == 4


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs the ffmpeg program to make the video")
@pytest.mark.parametrize(
    ("before", "after"),
    [
        # a camera that dropped two frames: the stamps have a gap that the numbers have not
        ((), ("-vf", "select='not(between(n,100,101))'", "-fps_mode", "passthrough", "-bf", "2", "-g", "40")),
        # a container whose list of edits hides the frames between a key frame and the first one
        (("-ss", "1.5"), ("-c", "copy")),
    ],
)
def test_identity_where_stamps_are_no_numbers(tmp_path: Path, before: tuple[str, ...], after: tuple[str, ...]) -> None:
    write_video(tmp_path / "plain.mp4", range(600), "mp4v")
    command = ["ffmpeg", "-v", "error", *before, "-i", str(tmp_path / "plain.mp4"), *after, str(tmp_path / "v.mp4")]
    if subprocess.run(command, stdin=subprocess.DEVNULL, check=False).returncode:
        pytest.skip("this ffmpeg cannot make the video")
    capture = cv2.VideoCapture(str(tmp_path / "v.mp4"), cv2.CAP_FFMPEG)
    one_by_one = []
    while (decoded := capture.read())[0]:
        one_by_one.append(number_of(np.asarray(decoded[1], dtype=np.uint8)))
    assert 580 < len(one_by_one) < 600
    wanted = [210, 350, 561]
    with reader(tmp_path / "v.mp4", wanted) as opened:
        shown = [picture for _ in wanted if (picture := opened.next()) is not None]
    assert [number_of(picture.image) for picture in shown] == [one_by_one[index] for index in wanted]


def test_identity_far_into_h264(landing_1: Path) -> None:
    """Expected: a frame by a seek to the second key frame, 250, and by decoding all before it are the same bytes."""
    path = landing_1 / "left.mp4"
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    plain: dict[int, NDArray[np.uint8]] = {}
    for index in range(291):
        good = capture.grab()
        assert good
        if index in (285, 286, 290):
            plain[index] = np.asarray(capture.retrieve()[1], dtype=np.uint8)
    capture.release()
    for wanted in ([285, 286], [290]):
        with reader(path, wanted, (1280, 960)) as opened:
            for index in wanted:
                picture = opened.next()
                assert picture is not None
                assert np.array_equal(picture.image, plain[index])


def test_a_seek_beyond_the_end_is_not_used(tmp_path: Path) -> None:
    write_video(tmp_path / "v.avi", range(250))
    capture = cv2.VideoCapture(str(tmp_path / "v.avi"), cv2.CAP_FFMPEG)
    assert not seek(capture, tmp_path / "v.avi", 260)
    capture.release()
    with (
        reader(tmp_path / "v.avi", [260]) as opened,
        pytest.raises(SessionError, match="the end of the video after 250"),
    ):
        opened.next()


# ------------------------------------------------------------------------------------------ life of threads
def test_all_threads_end_with_the_session(tmp_path: Path) -> None:
    folder = Tiny(rows=12).write(tmp_path)
    with FolderSource(load_session(folder)) as source:
        assert len(decoders()) > 0
        assert sum(1 for _ in source) > 0
    assert decoders() == []


def test_all_threads_end_when_the_consumer_has_enough(tmp_path: Path) -> None:
    folder = Tiny(rows=60, ptu_to_s=9.0).write(tmp_path)
    with FolderSource(load_session(folder)) as source:
        assert len(list(itertools.islice(source, 20))) == 20
        assert len(decoders()) == 2
    assert decoders() == []


def test_all_threads_end_without_requests(tmp_path: Path) -> None:
    with FolderSource(load_session(Tiny(rows=60, ptu_to_s=9.0).write(tmp_path))):
        pass
    assert decoders() == []


def test_all_threads_end_when_the_consumer_fails(tmp_path: Path) -> None:
    folder = Tiny(rows=60, ptu_to_s=9.0).write(tmp_path)

    def fail() -> None:
        with FolderSource(load_session(folder)) as source:
            for number, _ in enumerate(source):
                assert number < 30, "enough"

    with pytest.raises(AssertionError, match="enough"):
        fail()
    assert decoders() == []


def test_all_threads_end_when_one_video_is_at_fault(tmp_path: Path) -> None:
    folder = Tiny(rows=60, ptu_to_s=9.0).write(tmp_path)
    session = load_session(folder)
    (folder / "left.avi").write_bytes(b"")
    with FolderSource(session) as source, pytest.raises(SessionError, match=r"left.avi: got no video"):
        list(source)
    assert decoders() == []


def test_a_decoder_that_breaks_reaches_the_consumer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_pictures(tmp_path / "p", range(3))

    def broken(*_: object) -> None:
        raise RuntimeError("out of\nmemory")

    monkeypatch.setattr(cv2, "imdecode", broken)
    with (
        reader(tmp_path / "p", range(3)) as opened,
        pytest.raises(SessionError, match=r"p: got RuntimeError: out of\\nmemory"),
    ):
        opened.next()
    assert decoders() == []


def test_no_more_than_a_few_frames_are_held(tmp_path: Path) -> None:
    """Expected: with a consumer that never comes back, the queue's worth and the one in hand are decoded."""
    write_pictures(tmp_path / "p", range(40))
    read: list[object] = []
    enough = threading.Event()
    real = cv2.imdecode

    def counted(encoded: NDArray[np.uint8], flags: int) -> object:
        read.append(encoded)
        if len(read) == QUEUE_FRAMES + 1:
            enough.set()
        return real(encoded, flags)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cv2, "imdecode", counted)
        with reader(tmp_path / "p", range(40)):
            assert enough.wait(10.0)
            # the one in hand cannot be put down, so no further one is read
            assert not any(t.join(0.25) for t in threading.enumerate() if t.name.startswith("decode-"))
            assert len(read) == QUEUE_FRAMES + 1


def test_a_grey_picture_gets_three_equal_channels() -> None:
    reader = PictureReader.__new__(PictureReader)
    reader._size = (4, 3)
    grey = np.arange(12, dtype=np.uint8).reshape(3, 4)
    found = reader._checked(grey, 7, 9)
    assert found.index == 7
    assert found.image.shape == (3, 4, 3)
    for channel in range(3):
        np.testing.assert_array_equal(found.image[:, :, channel], grey)
