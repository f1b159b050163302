"""The pictures of a Rerun recording: the session's own files, as they are.

A video goes in whole, once; each frame then is a reference to its own presentation timestamp in that file.
A picture of an image folder goes in as the bytes on disk. Only what a recording kept of a picture has to be encoded.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from groundstation.arrays import ImageArray
from groundstation.errors import SessionError

# beyond this a video is left out: the recording keeps a file in one piece, and that piece in memory
MAX_VIDEO_BYTES = 1_000_000_000
_JPEG_QUALITY = 75
MEDIA_TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VideoAsset:
    """A station's video file; frame number n of the session is the n-th frame in order of presentation.

    ``frame_timestamps_ns`` (n,) int64 may give the presentation timestamps where they are known already;
    else they are read from the file.
    """

    path: Path
    frame_timestamps_ns: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageFolder:
    """A station's pictures on disk, JPEG or PNG, by frame number."""

    files: Mapping[int, Path] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedWindows:
    """A station's pictures come with its reports, as far as they were recorded."""


Media = VideoAsset | ImageFolder | RecordedWindows


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoadedVideo:
    """A video ready to be logged, and the presentation timestamp (n,) int64 ns of each of its frames."""

    asset: rr.AssetVideo
    timestamps_ns: NDArray[np.int64]


def load_video(video: VideoAsset) -> LoadedVideo:
    """Read a video file; raises `SessionError` if it is too large to embed or holds no video."""
    path = str(video.path)
    if not video.path.is_file():
        raise SessionError(path, got="no such file", wanted="a video")
    size = video.path.stat().st_size
    if size > MAX_VIDEO_BYTES:
        raise SessionError(path, got=f"{size} bytes", wanted=f"at most {MAX_VIDEO_BYTES} bytes to embed it")
    asset = rr.AssetVideo(path=video.path)
    if video.frame_timestamps_ns is not None:
        return LoadedVideo(asset=asset, timestamps_ns=video.frame_timestamps_ns)
    try:
        timestamps_ns = asset.read_frame_timestamps_nanos()
    except (RuntimeError, ValueError) as fault:
        raise SessionError(path, got=str(fault).splitlines()[0], wanted="an MP4 video") from fault
    return LoadedVideo(asset=asset, timestamps_ns=timestamps_ns)


def encoded_image(path: Path) -> rr.EncodedImage:
    """Return a picture as it lies on disk; raises `SessionError` if it is missing or of another kind."""
    media_type = MEDIA_TYPES.get(path.suffix.lower())
    if media_type is None:
        raise SessionError(str(path), got=f"a {path.suffix} file", wanted="a JPEG or PNG picture")
    try:
        contents = path.read_bytes()
    except OSError as fault:
        raise SessionError(str(path), got=str(fault.strerror), wanted="a readable picture") from fault
    return rr.EncodedImage(contents=contents, media_type=media_type)


def jpeg_image(picture: ImageArray) -> rr.EncodedImage:
    """Return a picture (h, w, 3) BGR for a person's eyes; pixels are measured before, not in this."""
    _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg")
