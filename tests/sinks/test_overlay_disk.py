"""A video that cannot be begun."""

from pathlib import Path

import cv2
import pytest

from groundstation.errors import InputError
from groundstation.sinks.overlay_video import OverlayVideo


def test_a_video_that_cannot_be_begun_is_named_by_its_own_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: also where FFmpeg has removed the draft, as on a full disk, and nothing is left."""

    class Refused:
        def __init__(self, path: str, *_: object) -> None:
            Path(path).unlink()

        def isOpened(self) -> bool:  # noqa: N802 - OpenCV's name
            return False

    monkeypatch.setattr(cv2, "VideoWriter", Refused)
    path = tmp_path / "seen.mp4"
    with pytest.raises(InputError, match=r"seen\.mp4: got a file that OpenCV cannot write; wanted .* room on the disk"):
        OverlayVideo(path, (64, 48), 10.0)
    assert list(tmp_path.iterdir()) == []
