"""Seeking a frame of a video by its number, exactly or not at all.

Seeking uses time stamps. Only where these are even from the first frame to the requested one is a stamp equivalent
to a number; a camera that dropped frames leaves gaps. The stamps are read from the container, without decoding.
"""

from pathlib import Path

import cv2

from groundstation.session.media import open_packets

# largest displacement of a coded frame in the display order (H.264 allows 16)
_REORDERED = 32
# grabbing forward from the key frame that a seek lands on
_MAX_FORWARD = 2000


def seek(capture: cv2.VideoCapture, path: Path, index: int) -> bool:
    """Bring an opened video to the point where the next frame is number ``index`` (> 0).

    Returns False if that cannot be made sure; the capture then stands anywhere.
    """
    stamps = _stamps(path, index + _REORDERED)
    if len(stamps) <= index or not _even(stamps[: index + 1]):
        return False
    goal = stamps[index - 1]
    # seek slightly before; the position of a seek is known only from the stamp of the next grabbed frame
    rate = capture.get(cv2.CAP_PROP_FPS)
    capture.set(cv2.CAP_PROP_POS_FRAMES, max(0.0, min(index - 1.0, goal * rate / 1000.0) - 8.0))
    for _ in range(_MAX_FORWARD):
        if not capture.grab():
            return False
        stamp = capture.get(cv2.CAP_PROP_POS_MSEC)
        if stamp >= goal:
            return stamp == goal
    return False


def _stamps(path: Path, count: int) -> list[float]:
    """Return the presentation stamps in ms of the first ``count`` coded frames, sorted."""
    packets = open_packets(path)
    stamps: list[float] = []
    try:
        while len(stamps) < count and packets.isOpened() and packets.grab():
            stamps.append(packets.get(cv2.CAP_PROP_POS_MSEC))
    finally:
        packets.release()
    return sorted(stamps)


def _even(stamps_ms: list[float]) -> bool:
    """Return whether sorted stamps are evenly spaced from 0, but for the container's rounding."""
    step = stamps_ms[-1] / (len(stamps_ms) - 1)
    return step > 0 and all(abs(stamp - number * step) < 0.25 * step for number, stamp in enumerate(stamps_ms))
