"""Any video file as a stream of frames with their times; nothing else has to be known of it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.errors import InputError
from groundstation.session.media import open_video
from groundstation.sources.video_seek import seek

_SEEK_BEYOND = 200  # forward decoding of so few frames is as quick as a seek
_UNKNOWN_RATE = 30.0  # a container that tells neither stamps nor a rate
_MAX_RATE = 10_000.0
_MISSING_SHARE = 0.02  # where a header's number is only estimated it may be off by so much
_FIRST_TRIED = 30  # the first frames may be damaged
_MOST_LOST = 300  # damaged frames in a row after which nothing more is expected


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VideoFrame:
    """One decoded frame: its number in the file from 0, its time in s, and its pixels (h, w, 3) uint8 BGR."""

    index: int
    t_s: float
    image: ImageArray


class VideoFile:
    """A video file and what its header tells.

    Raises `InputError` where there is no such file or it is no video.

    Attributes
    ----------
    size_px : (w, h) of every frame.
    rate_hz : frames per second; 30 where the header does not tell.
    count : how many frames the header announces, None if it does not.
    lost : the numbers of the damaged frames that `frames` has passed over.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            got = "a folder" if path.is_dir() else "no file" if path.exists() else "no such file"
            raise InputError(str(path), got=got, wanted="a video file")
        capture = open_video(path)
        try:
            if not capture.isOpened() or not any(capture.grab() for _ in range(_FIRST_TRIED)):
                raise InputError(str(path), got="no video that OpenCV can open", wanted="a complete video file")
            width, height = (int(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
            rate, count = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
        finally:
            capture.release()
        self.size_px = (width, height)
        self.rate_hz = float(rate) if 0.0 < rate <= _MAX_RATE else _UNKNOWN_RATE
        self.count = int(count) if math.isfinite(count) and 0 < count < 1e9 else None
        self.lost: list[int] = []

    def frames(self, first: int = 0, last: int | None = None) -> Iterator[VideoFrame]:
        """Yield frames number ``first`` to ``last``, both included, one at a time; to the end if None.

        A frame's time is its stamp in the container, or number / rate where the stamps do not grow. Damaged frames
        are left out: their numbers are missing, and in ``lost``. Raises `InputError` where the video ends before the
        number of frames that its header announces.
        """
        capture, place = self._opened_at(first)
        self.lost = []
        newest_s, failed = -math.inf, 0
        try:
            while last is None or place + failed <= last:
                if not capture.grab():
                    # each frame that is damaged fails once, and after the last one all do
                    failed += 1
                    if failed >= _MOST_LOST or (self.count is not None and place + failed >= self.count):
                        self._ended(place, first)
                        return
                    continue
                self._pass_over(place, failed, first)
                place, failed = place + failed, 0
                stamp_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
                if place >= first:
                    good, decoded = capture.retrieve()
                    if not good:
                        raise InputError(
                            f"{self.path}: frame {place}", got="what cannot be decoded", wanted="a complete video file"
                        )
                    newest_s = self._time(place, stamp_ms, newest_s)
                    yield VideoFrame(index=place, t_s=newest_s, image=np.asarray(decoded, np.uint8))
                place += 1
            self._pass_over(place, failed, first)
        finally:
            capture.release()

    def _pass_over(self, place: int, count: int, first: int) -> None:
        """Note so many damaged frames from ``place`` on, as far as they were asked for."""
        self.lost += range(max(place, first), place + count)

    def lost_line(self) -> str | None:
        """Return one line for a person about the damaged frames, None where there are none."""
        if not self.lost:
            return None
        many = f"{len(self.lost)} damaged frames are" if len(self.lost) > 1 else "a damaged frame is"
        return f"{many} left out of {self.path}, {'the first ' if len(self.lost) > 1 else ''}number {self.lost[0]}"

    def _opened_at(self, first: int) -> tuple[cv2.VideoCapture, int]:
        """Return the opened video and the number of the frame that it gives next, at most ``first``."""
        capture = open_video(self.path)
        if first >= _SEEK_BEYOND:
            if seek(capture, self.path, first):
                return capture, first
            capture.release()
            capture = open_video(self.path)
        return capture, 0

    def _time(self, index: int, stamp_ms: float, newest_s: float) -> float:
        """Return the time of a frame, which always grows."""
        if math.isfinite(stamp_ms) and (stamp_ms > 0.0 or index == 0) and 1e-3 * stamp_ms > newest_s:
            return 1e-3 * stamp_ms
        return max(index / self.rate_hz, newest_s + 1.0 / self.rate_hz)

    def _ended(self, place: int, first: int) -> None:
        """Raise an error if the video has ended before its time, or before the frame that was asked for."""
        if place <= first:
            got = f"a video of {place} frames"
            raise InputError(str(self.path), got=got, wanted=f"more, to start from frame {first}")
        if self.count is not None and place < self.count - max(1, _MISSING_SHARE * self.count):
            got = f"the end of the video after {place} frames of the {self.count} that its header announces"
            raise InputError(f"{self.path}: frame {place}", got=got, wanted="a complete video file")


def refuse_other_times(path: Path, span_s: tuple[float, float], video: VideoFile) -> None:
    """Raise `InputError` where a log's or a track's first and last time (s) and the video have no time in common."""
    first, last = span_s
    # stamps may begin a little later than 0, and a rate is rounded
    length = math.inf if video.count is None else (video.count + 1) / video.rate_hz
    if last < 0.0 or first > length:
        until = "on" if video.count is None else f"to {video.count / video.rate_hz:.6g} s"
        got = f"times from {first:.6g} to {last:.6g} s"
        raise InputError(f"{path}: t_s", got=got, wanted=f"the video's, from 0 {until}")
