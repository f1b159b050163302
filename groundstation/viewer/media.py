"""The pictures of a Rerun recording: the session's own files, as they are.

A video goes in once, whole or in parts; each frame then is a reference to its own presentation timestamp in that file.
A picture of an image folder goes in as the bytes on disk. Re-encoded are only the picture windows of a recording, and
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
from groundstation.sinks.mp4_parts import Mp4Samples, mp4_samples
from groundstation.sinks.mp4_tables import mp4_fault

# Rerun keeps a piece as one, and that in memory three times: a larger video goes in as several
PART_BYTES = 32_000_000
# and one that cannot be cut, beyond this, picture by picture
MAX_VIDEO_BYTES = 250_000_000
# what a viewer takes as it is
MEDIA_TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VideoAsset:
    """A station's video file; its frame n is the n-th in order of presentation.

    ``frame_timestamps_ns`` (n,) int64 may give the presentation timestamps where they are known already;
    else they are read from the file. ``frame_numbers`` is the frame of each pair, by the pair's number; None: the same.
    """

    path: Path
    frame_timestamps_ns: NDArray[np.int64] | None = None
    frame_numbers: Mapping[int, int] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageFolder:
    """A station's pictures on disk, JPEG or PNG, by the number of their pair."""

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EmbeddedVideo:
    """A video in a recording, whole or in parts: ``entities`` are those of its parts, one after the other.

    ``timestamps_ns`` (n,) int64 is each frame's presentation timestamp in its part, ``part`` (n,) the number of that.
    """

    entities: tuple[str, ...] = ()
    timestamps_ns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    part: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __len__(self) -> int:
        return len(self.timestamps_ns)

    def references(self, numbers: NDArray[np.int64]) -> rr.ComponentColumnList:
        """Return a row for each frame of these numbers: which video, and where in it."""
        columns = rr.VideoFrameReference.columns_nanos(self.timestamps_ns[numbers])
        if len(self.entities) < 2:
            return columns
        entities = [f"/{self.entities[k]}" for k in self.part[numbers]]
        return rr.ComponentColumnList([*columns, *rr.VideoFrameReference.columns(video_reference=entities)])


def load_video(video: VideoAsset) -> LoadedVideo:
    """Read a video file; raises `SessionError` if it is too large to embed in one piece or holds no video."""
    path = str(video.path)
    _check_video(video.path)
    size = video.path.stat().st_size
    if size > MAX_VIDEO_BYTES:
        raise SessionError(path, got=f"{size} bytes", wanted=f"at most {MAX_VIDEO_BYTES} bytes to embed it")
    asset = rr.AssetVideo(path=video.path)
    if video.frame_timestamps_ns is not None:
        return LoadedVideo(asset=asset, timestamps_ns=video.frame_timestamps_ns)
    return LoadedVideo(asset=asset, timestamps_ns=_timestamps_ns(asset, path))


def log_video(stream: rr.RecordingStream, entity: str, video: VideoAsset) -> EmbeddedVideo:
    """Log a video file, a large one in parts; raises `SessionError` if it cannot be embedded."""
    _check_video(video.path)
    if video.path.stat().st_size > PART_BYTES and video.frame_timestamps_ns is None:
        try:
            samples = mp4_samples(video.path)
        except SessionError:
            # as one piece, where it is not too large for that
            pass
        else:
            return _log_parts(stream, entity, samples)
    loaded = load_video(video)
    _send(stream, entity, loaded.asset)
    return EmbeddedVideo(
        entities=(entity,),
        timestamps_ns=loaded.timestamps_ns,
        part=np.zeros(len(loaded.timestamps_ns), dtype=np.int64),
    )


def _log_parts(stream: rr.RecordingStream, entity: str, samples: Mp4Samples) -> EmbeddedVideo:
    """Log a video as several; raises `SessionError` where a part is too large, before anything is logged."""
    parts = samples.parts(PART_BYTES)
    largest = max(int(samples.size[part].sum()) for part in parts)
    if largest > MAX_VIDEO_BYTES:
        wanted = f"at most {MAX_VIDEO_BYTES} bytes to embed it"
        raise SessionError(str(samples.path), got=f"{largest} bytes without a key frame", wanted=wanted)
    entities, times = [], []
    for number, part in enumerate(parts):
        asset = rr.AssetVideo(contents=samples.file(part), media_type="video/mp4")
        times.append(_timestamps_ns(asset, str(samples.path)))
        entities.append(f"{entity}/part/{number:04d}")
        _send(stream, entities[-1], asset)
    return EmbeddedVideo(
        entities=tuple(entities),
        timestamps_ns=np.concatenate(times),
        part=np.repeat(np.arange(len(parts)), [len(t) for t in times]),
    )


def _check_video(path: Path) -> None:
    """Raise `SessionError` for what is no video, or would keep Rerun's reader for ever."""
    if not path.is_file():
        raise SessionError(str(path), got="no such file", wanted="a video")
    fault = mp4_fault(path)
    if fault:
        raise SessionError(str(path), got=fault, wanted="an MP4 video")


def _timestamps_ns(asset: rr.AssetVideo, path: str) -> NDArray[np.int64]:
    try:
        return asset.read_frame_timestamps_nanos()
    except (RuntimeError, ValueError) as error:
        raise SessionError(path, got=str(error).splitlines()[0], wanted="an MP4 video") from error


def _send(stream: rr.RecordingStream, entity: str, asset: rr.AssetVideo) -> None:
    """Log a piece, which goes to the file now, and its memory back to the system."""
    stream.log(entity, asset, static=True)
    stream.flush()
    pa.default_memory_pool().release_unused()
