"""A video that opens and has no frame."""

from pathlib import Path

import pytest

from groundstation.errors import SessionError
from groundstation.session import media
from groundstation.session.media import _video_size


class Empty:
    """A capture that is opened and gives nothing."""

    def __init__(self, opened: bool) -> None:
        self.opened, self.released = opened, False

    def isOpened(self) -> bool:  # noqa: N802
        return self.opened

    def grab(self) -> bool:
        return False

    def get(self, what: int) -> float:
        return 640.0

    def release(self) -> None:
        self.released = True


@pytest.mark.parametrize(
    ("opened", "got"), [(True, "a video without frames"), (False, "no video that OpenCV can open")]
)
def test_it_is_named_and_let_go_of(opened: bool, got: str, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = Empty(opened)
    monkeypatch.setattr(media, "open_video", lambda path: capture)
    with pytest.raises(SessionError, match=f"got {got}"):
        _video_size(Path("left.mp4"))
    assert capture.released
