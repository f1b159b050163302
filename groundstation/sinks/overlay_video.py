"""Overlay of one camera's tracker on its pictures, written as a video."""

import contextlib
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import ImageArray
from groundstation.box import Box, expand
from groundstation.detection.pixel_track import PixelTrack
from groundstation.errors import InputError, os_words
from groundstation.files.video_check import require_whole_video
from groundstation.files.whole_file import whole_file
from groundstation.messages import Detection

Colour = tuple[int, int, int]

# BGR
_ROI: Colour = (90, 225, 255)
_CONTOUR: Colour = (120, 230, 120)
_BOX: Colour = (255, 220, 90)
_TARGET: Colour = (60, 60, 255)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_TEXT: Colour = (255, 255, 255)
_PLATE: Colour = (0, 0, 0)
_CROSS_OPEN_PX, _CROSS_PX = 4, 9
_BOX_MARGIN_PX = 3  # the box is drawn around the silhouette, not over its rim
_SHIFT = 4  # cv2 draws lines to 1/16 px
# 4 characters of 8 bits, as OpenCV packs them
_MP4V = sum(ord(c) << 8 * i for i, c in enumerate("mp4v"))


def draw_track(image: ImageArray, index: int, track: PixelTrack) -> ImageArray:
    """Return a copy of a frame (h, w, 3) BGR with region of interest, outline, box, target point and status."""
    picture = image.copy()
    if track.roi is not None:
        x0, y0, x1, y1 = track.roi
        cv2.rectangle(picture, (x0, y0), (x1 - 1, y1 - 1), _ROI, 1)
    if isinstance(track.result, Detection):
        found = track.result
        cv2.polylines(picture, _pieces(found.contour_px), True, _CONTOUR, 1, cv2.LINE_AA, _SHIFT)
        drawn = expand(Box(*(round(edge) for edge in found.box)), _BOX_MARGIN_PX)
        cv2.rectangle(picture, (drawn.x0, drawn.y0), (drawn.x1, drawn.y1), _BOX, 1)
        _mark(picture, round(found.u_px), round(found.v_px))
    _write(picture, f"{index}  {track.t_s:.2f} s  {track.status.value}")
    return picture


def _mark(picture: ImageArray, u: int, v: int) -> None:
    """Draw a cross with an open centre, so that an aircraft of a few pixels stays visible."""
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        inner, outer = (u + _CROSS_OPEN_PX * x, v + _CROSS_OPEN_PX * y), (u + _CROSS_PX * x, v + _CROSS_PX * y)
        cv2.line(picture, inner, outer, _TARGET, 1)


def _pieces(contour_px: NDArray[np.float32]) -> list[NDArray[np.int32]]:
    """Return the closed pieces of an outline (n, 2) that rows of NaN separate, in 1/16 px."""
    gaps = np.isnan(contour_px[:, 0])
    pieces = np.split(contour_px, np.flatnonzero(gaps))
    whole = [p[~np.isnan(p[:, 0])] for p in pieces]
    return [np.round(p * 2**_SHIFT).astype(np.int32).reshape(-1, 1, 2) for p in whole if len(p)]


def _write(picture: ImageArray, text: str) -> None:
    """Write a line at the top left on a plate, legible on any background and after compression."""
    scale = max(0.55, picture.shape[1] / 1400)
    stroke = max(round(1.4 * scale), 1)
    (w, h), below = cv2.getTextSize(text, _FONT, scale, stroke)
    pad = round(8 * scale)
    cv2.rectangle(picture, (0, 0), (w + 2 * pad, h + below + 2 * pad), _PLATE, cv2.FILLED)
    cv2.putText(picture, text, (pad, pad + h), _FONT, scale, _TEXT, stroke, cv2.LINE_AA)


class _NoFrameError(Exception):
    """Closed before its first frame: an interrupt while the tracker is compiled."""


class OverlayVideo:
    """An MP4 video of drawn frames.

    Parameters
    ----------
    path : the file, `….mp4`; an older one is replaced when this one is closed, also if that is early. Without a frame
        there is no video, and an older one stays.
    size_px : (w, h) of every frame.
    rate_hz : frames per second.
    """

    def __init__(self, path: Path, size_px: tuple[int, int], rate_hz: float) -> None:
        self._path = path
        self._opened = ExitStack()
        self._draft = self._opened.enter_context(whole_file(path))
        try:
            # OpenCV does not report why it cannot write
            self._draft.open("wb").close()
        except OSError as fault:
            raise InputError(str(path), got=os_words(fault), wanted="a video that can be written") from fault
        self._frames = 0
        self._writer = cv2.VideoWriter(str(self._draft), _MP4V, rate_hz, size_px)
        if not self._writer.isOpened():
            # FFmpeg may have removed it
            self._draft.unlink(missing_ok=True)
            wanted = "an .mp4 file of a usual size, and room on the disk"
            raise InputError(str(path), got="a file that OpenCV cannot write", wanted=wanted)

    def __enter__(self) -> "OverlayVideo":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._writer.release()
        with contextlib.suppress(_NoFrameError), self._opened:
            if not self._frames:
                # no program reads such a file
                raise _NoFrameError
            try:
                require_whole_video(self._draft, self._frames)
            except OSError as fault:
                wanted = "room on the disk: it was given up, what else was written is whole"
                raise InputError(str(self._path), got=os_words(fault), wanted=wanted) from fault

    def write(self, picture: ImageArray) -> None:
        """Append a drawn frame (h, w, 3) BGR."""
        self._writer.write(picture)
        self._frames += 1
