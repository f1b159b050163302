"""Time of each frame of a video from its container's stamps, which need not be evenly spaced."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from groundstation.session.media import open_video

_MAX_FRAMES = 10_000_000
_MISSING_SHARE = 0.02
_UNEVEN = 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VideoStamps:
    """A video's frames: ``t_s`` (n,) since the first, rising; ``size_px`` (w, h); ``remarks``, a line each."""

    path: Path
    t_s: FloatArray
    size_px: tuple[int, int]
    remarks: tuple[str, ...]

    def summary(self) -> str:
        """Return number, length, rate and evenness in a line."""
        steps = np.diff(self.t_s)
        middle = float(np.median(steps))
        uneven = int(np.sum(steps > _UNEVEN * middle))
        gaps = f", {uneven} gaps up to {float(steps.max()):.3f} s" if uneven else ""
        return f"{self.path.name}: {len(self.t_s)} frames in {self.t_s[-1]:.2f} s, one each {middle * 1e3:.2f} ms{gaps}"


def read_video_stamps(path: Path, progress: Callable[[int], None] = lambda _: None) -> VideoStamps:
    """Read the stamps of all frames that decode, as a replay will decode them.

    Raises `InputError` where the file is no video, has fewer than two frames, or its stamps do not grow.
    """
    if not path.is_file():
        got = "a folder" if path.is_dir() else "no such file"
        raise InputError(str(path), got=got, wanted="a video file")
    capture = open_video(path)
    stamps: list[float] = []
    try:
        while capture.isOpened() and capture.grab() and len(stamps) < _MAX_FRAMES:
            stamp = capture.get(cv2.CAP_PROP_POS_MSEC) * 1e-3
            if not math.isfinite(stamp) or (stamps and stamp <= stamps[-1]):
                got = f"a stamp of {stamp:.6g} s after one of {stamps[-1] if stamps else 0.0:.6g} s"
                wanted = "stamps that grow; or the times of the frames in a table, --frames"
                raise InputError(f"{path.name}: frame {len(stamps)}", got=got, wanted=wanted)
            stamps.append(stamp)
            if len(stamps) % 50 == 0:
                progress(len(stamps))
        size = tuple(int(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        announced = capture.get(cv2.CAP_PROP_FRAME_COUNT)
    finally:
        capture.release()
    if len(stamps) < 2:
        got = f"{len(stamps)} frames" if stamps else "no video that OpenCV can open"
        raise InputError(path.name, got=got, wanted="a complete video file")
    remarks = []
    if math.isfinite(announced) and 0 < announced < 1e9 and len(stamps) < announced * (1.0 - _MISSING_SHARE):
        remarks.append(
            f"{path.name}: cut short: {len(stamps)} frames of the {int(announced)} that its header announces"
        )
    t = np.array(stamps)
    return VideoStamps(path=path, t_s=t - t[0], size_px=(size[0], size[1]), remarks=tuple(remarks))
