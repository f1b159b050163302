"""A video is let go of when its reader is done with it, also before its end."""

from pathlib import Path

import pytest

from groundstation.sources.video_file import VideoFile
from tests.session.folder import write_video


class PollStatistics:
    """A capture that notes that it was released."""

    def __init__(self, capture: object) -> None:
        self._capture = capture
        self.released = 0

    def __getattr__(self, name: str) -> object:
        return getattr(self._capture, name)

    def release(self) -> None:
        self.released += 1
        self._capture.release()


def test_a_reader_that_ends_early_releases_the_video(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_video(tmp_path / "left.avi", range(5))
    opened: list[PollStatistics] = []
    plain = VideoFile._opened_at

    def watched(self: VideoFile, first: int) -> tuple[PollStatistics, int]:
        capture, place = plain(self, first)
        opened.append(PollStatistics(capture))
        return opened[-1], place

    monkeypatch.setattr(VideoFile, "_opened_at", watched)
    frames = VideoFile(tmp_path / "left.avi").frames()
    assert next(frames).index == 0
    assert [capture.released for capture in opened] == [0]
    frames.close()
    assert [capture.released for capture in opened] == [1]
