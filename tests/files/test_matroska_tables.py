"""A Matroska file whose tables are repeated is not opened; FFmpeg would keep each copy (found by the reader fuzz)."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.errors import SessionError
from groundstation.files.matroska_tables import repeats_tables
from groundstation.session.media import Medium, MediumKind, check_medium, open_packets, open_video
from tests.complaints import complaint

TRACKS = bytes.fromhex("1654ae6b")
CLUSTER = bytes.fromhex("1f43b675")


@pytest.fixture
def video(tmp_path: Path) -> Path:
    path = tmp_path / "left.mkv"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 10.0, (64, 48))
    for shade in (10, 120, 240):
        writer.write(np.full((48, 64, 3), shade, np.uint8))
    writer.release()
    return path


def with_copies(path: Path, name: bytes, times: int) -> None:
    """Put copies of an element, from its name to the first cluster, before that cluster."""
    content = path.read_bytes()
    cluster = content.index(CLUSTER)
    element = content[content.rindex(name, 0, cluster) : cluster]
    path.write_bytes(content[:cluster] + times * element + content[cluster:])


def test_what_a_program_wrote_is_opened(video: Path) -> None:
    assert not repeats_tables(video)
    assert open_video(video).isOpened()
    assert open_packets(video).isOpened()


@pytest.mark.parametrize("times", [40, 2000])
def test_tables_over_and_over_are_refused_before_they_are_decoded(video: Path, times: int) -> None:
    with_copies(video, TRACKS, times)
    assert repeats_tables(video)
    assert not open_video(video).isOpened()
    assert not open_packets(video).isOpened()
    reported = complaint(SessionError, lambda: check_medium(Medium(kind=MediumKind.VIDEO, path=video), (64, 48)))
    assert "left.mkv: got no video that OpenCV can open; wanted a complete video file" in reported


def test_a_second_table_and_similar_bytes_are_not_a_fault(video: Path) -> None:
    with_copies(video, TRACKS, 1)
    video.write_bytes(video.read_bytes() + 8 * (TRACKS + bytes(500)))
    assert not repeats_tables(video)


@pytest.mark.parametrize("content", [b"", b"\x1a\x45", 100 * TRACKS])
def test_what_is_no_matroska_is_left_to_its_own_reader(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "left.avi"
    path.write_bytes(content)
    assert not repeats_tables(path)
    assert not repeats_tables(tmp_path / "none.mkv")
