"""The check that a written video is whole: OpenCV says nothing where the disk takes no more."""

import errno
from pathlib import Path

import cv2


def require_whole_video(path: Path, frames: int) -> None:
    """Raise `OSError` unless the last of so many frames can be decoded."""
    if frames == 0:
        return
    video = cv2.VideoCapture(str(path))
    try:
        video.set(cv2.CAP_PROP_POS_FRAMES, frames - 1)
        good = video.isOpened() and video.read()[0] and round(video.get(cv2.CAP_PROP_POS_FRAMES)) == frames
    finally:
        video.release()
    if not good:
        raise OSError(errno.EIO, f"not all of {frames} frames came to the disk: is it full?", str(path))
