"""The pictures of a Rerun recording: the session's own files, as they are.

A video goes in whole, once; each frame then is a reference to its own presentation timestamp in that file.
A picture of an image folder goes in as the bytes on disk. Encoded anew is only what a recording kept of a picture, and
a video that Rerun cannot read or that is too large (`rerun_pictures`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from groundstation.errors import SessionError
from groundstation.sinks.mp4_tables import mp4_fault

# beyond this a video goes in picture by picture: Rerun keeps a file in one piece, and that piece in memory three times
MAX_VIDEO_BYTES = 250_000_000
# what a viewer takes as it is
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
    """A station's pictures come with its reports, as far as they were recorded.

    ``expected`` is how many frames there are, 0 where that is not known.
    """

    expected: int = 0


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
    fault = mp4_fault(video.path)
    if fault:
        # Rerun's reader would not come to an end
        raise SessionError(path, got=fault, wanted="an MP4 video")
    asset = rr.AssetVideo(path=video.path)
    if video.frame_timestamps_ns is not None:
        return LoadedVideo(asset=asset, timestamps_ns=video.frame_timestamps_ns)
    try:
        timestamps_ns = asset.read_frame_timestamps_nanos()
    except (RuntimeError, ValueError) as error:
        raise SessionError(path, got=str(error).splitlines()[0], wanted="an MP4 video") from error
    return LoadedVideo(asset=asset, timestamps_ns=timestamps_ns)


def log_video(stream: rr.RecordingStream, entity: str, video: VideoAsset) -> NDArray[np.int64]:
    """Log a video file and return its frames' timestamps (n,); raises `SessionError` if it cannot be embedded."""
    loaded = load_video(video)
    stream.log(entity, loaded.asset, static=True)
    timestamps_ns = loaded.timestamps_ns
    del loaded
    # the piece goes to the file now, and its memory back to the system
    stream.flush()
    pa.default_memory_pool().release_unused()
    return timestamps_ns
