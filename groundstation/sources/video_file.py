"""A video file as a stream of frames with their times."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.errors import InputError
from groundstation.session.media import TEXT_SUFFIXES, open_packets, open_video, require_readable
from groundstation.sources.video_seek import seek

_SEEK_BEYOND = 200  # forward decoding of so few frames is as quick as a seek
_UNKNOWN_RATE = 30.0  # a container with neither stamps nor a rate
_MAX_RATE = 10_000.0
_MISSING_SHARE = 0.02  # where a header's number is only estimated it may be off by so much
_MOST_LOST = 300  # damaged frames in a row after which nothing more is expected


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VideoFrame:
    """One decoded frame: its number in the file from 0, its time in s, and its pixels (h, w, 3) uint8 BGR."""

    index: int
    t_s: float
    image: ImageArray


class VideoFile:
    """A video file and its header.

    Raises `InputError` if the file is missing or no video.

    Attributes
    ----------
    size_px : (w, h) of every frame.
    rate_hz : frames per second; 30 if the header has none.
    count : how many frames the header announces, None if it does not.
    lost : the numbers of the damaged frames that `frames` has skipped.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            got = "a folder" if path.is_dir() else "no regular file" if path.exists() else "no such file"
            raise InputError(str(path), got=got, wanted="a video file")
        if path.suffix.lower() in TEXT_SUFFIXES:
            raise InputError(str(path), got=f"a file {path.suffix}", wanted="a video file")
        require_readable(path, str(path), InputError)
        capture = open_video(path)
        try:
            if not capture.isOpened() or not any(capture.grab() for _ in range(_MOST_LOST)):
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
        newest_s, numbers = -math.inf, _FrameNumbers(self.path, place, self.rate_hz)
        try:
            while last is None or numbers.next <= last:
                if not capture.grab():
                    if numbers.fail():
                        continue
                    self._pass_over(numbers.next, numbers.held, first, last)
                    self._ended(numbers.held, first)
                    return
                stamp_ms = capture.get(cv2.CAP_PROP_POS_MSEC)
                due, place = numbers.next, numbers.take(stamp_ms)
                self._pass_over(due, place, first, last)
                if last is not None and place > last:
                    return
                if place >= first:
                    good, decoded = capture.retrieve()
                    if not good:
                        raise InputError(
                            f"{self.path}: frame {place}", got="what cannot be decoded", wanted="a complete video file"
                        )
                    newest_s = self._time(place, stamp_ms, newest_s)
                    yield VideoFrame(index=place, t_s=newest_s, image=np.asarray(decoded, np.uint8))
        finally:
            capture.release()

    def _pass_over(self, due: int, until: int, first: int, last: int | None) -> None:
        """Note the damaged frames from number ``due`` to before ``until``, as far as they were asked for."""
        self.lost += range(max(due, first), until if last is None else min(until, last + 1))

    def lost_line(self) -> str | None:
        """Return one line for the user about the damaged frames, None without any."""
        if not self.lost:
            return None
        if len(self.lost) == 1:
            return f"a damaged frame in {self.path}, number {self.lost[0]}"
        return f"{len(self.lost)} damaged frames in {self.path}, the first number {self.lost[0]}"

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


class _FrameNumbers:
    """Numbers of the decoded frames of a file with damaged ones.

    A damaged frame fails about once: at its turn in the coding order, which is not the display order.
    Even stamps identify the missing ones; without them the failed frames are taken to be those just before.

    Attributes
    ----------
    next : the next number.
    held : number of frames in the file, with damaged ones; known once one has failed.
    """

    def __init__(self, path: Path, place: int, rate_hz: float) -> None:
        self._path, self._rate = path, rate_hz
        self.next = place
        self.held = 0
        self._failed, self._even, self._damaged = 0, True, False
        self._last_ms: float | None = None

    def fail(self) -> bool:
        """Count a frame that failed to decode; returns False at the end of the file."""
        if not self._damaged:
            self.held = _coded_frames(self._path)
            self._damaged = True
        self.held = max(self.held, self.next)
        self._failed += 1
        return self.next + self._failed <= self.held

    def take(self, stamp_ms: float) -> int:
        """Return the number of the decoded frame."""
        grown = self._last_ms is not None and math.isfinite(stamp_ms) and stamp_ms > self._last_ms
        steps = round((stamp_ms - (self._last_ms or 0.0)) * 1e-3 * self._rate) if grown else 0
        by_stamp = self._damaged and self._even and steps > 0
        missing = steps - 1 if by_stamp else self._failed
        if not self._damaged and self._last_ms is not None:
            self._even = self._even and steps == 1
        number = self.next + missing
        self.next, self._failed, self._last_ms = number + 1, max(self._failed - missing, 0), stamp_ms
        return number


def _coded_frames(path: Path) -> int:
    """Return how many coded frames a video file holds, without decoding them; those at its end may be missing."""
    packets = open_packets(path)
    count, failed = 0, 0
    try:
        while failed < _MOST_LOST and packets.isOpened():
            if packets.grab():
                count, failed = count + failed + 1, 0
            else:
                failed += 1
    finally:
        packets.release()
    return count


def refuse_other_times(path: Path, span_s: tuple[float, float], video: VideoFile) -> None:
    """Raise `InputError` where a log's or a track's first and last time (s) and the video have no time in common."""
    first, last = span_s
    # stamps may begin a little later than 0, and a rate is rounded
    length = math.inf if video.count is None else (video.count + 1) / video.rate_hz
    if last < 0.0 or first > length:
        until = "on" if video.count is None else f"to {video.count / video.rate_hz:.6g} s"
        got = f"times from {first:.6g} to {last:.6g} s"
        raise InputError(f"{path}: t_s", got=got, wanted=f"the video's, from 0 {until}")
