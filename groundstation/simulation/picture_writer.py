"""One camera's pictures as a file of a session: H.264, JPEG or lossless video, or PNG files."""

from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.errors import InputError
from groundstation.files.output_names import below
from groundstation.files.video_check import require_whole_video
from groundstation.simulation.parameter_checks import require

_DEFAULT_JPEG_QUALITY = 95
# FFmpeg's own default for libx264
_DEFAULT_CRF = 23
_MAX_CRF = 51
# a key frame every so many, so that a reader can begin in the middle
_KEY_EVERY = 30


class PictureFormat(StrEnum):
    """Format of stored pictures: JPEG frames or lossless FFV1 in an AVI, H.264 in an MP4, or PNG files."""

    JPEG = "jpeg"
    H264 = "h264"
    LOSSLESS = "lossless"
    PNG = "png"


class NoVideoCoderError(InputError):
    """PyAV, which brings an H.264 coder, is not installed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureCoding:
    """A format and its ``quality``: JPEG's from 1 to 100, or H.264's CRF from 0 (best) to 51; None is 95 or 23."""

    form: PictureFormat = PictureFormat.JPEG
    quality: int | None = None

    def __post_init__(self) -> None:
        where, got = "PictureCoding: quality", self.quality
        if self.form is PictureFormat.JPEG:
            require(got is None or 1 <= got <= 100, where, got=got, wanted="a JPEG quality from 1 to 100")
        elif self.form is PictureFormat.H264:
            require(got is None or 0 <= got <= _MAX_CRF, where, got=got, wanted=f"a CRF from 0 to {_MAX_CRF}")
        else:
            require(got is None, where, got=got, wanted=f"none: {self.form} loses nothing")


class PictureWriter(Protocol):
    """One station's pictures by number, from 0 on; to be left as a context manager."""

    def write(self, number: int, image: ImageArray | None) -> None:
        """Write picture ``number`` (h, w, 3) BGR; None is a missing one, which keeps its number."""

    def __enter__(self) -> "PictureWriter": ...

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None: ...


def picture_writer(
    folder: Path, name: str, size_px: tuple[int, int], coding: PictureCoding, rate_hz: float
) -> PictureWriter:
    """Open the file or folder of a station's pictures; the frame rate is a header's formality: frames.csv rules.

    Raises `InputError` where OpenCV does not write the format, `NoVideoCoderError` without PyAV for H.264.
    """
    rate_hz = max(rate_hz, 1.0)
    match coding.form:
        case PictureFormat.PNG:
            return _PngWriter(below(folder, name))
        case PictureFormat.H264:
            crf = _DEFAULT_CRF if coding.quality is None else coding.quality
            return _H264Writer(below(folder, f"{name}.mp4"), size_px, crf, rate_hz)
        case PictureFormat.LOSSLESS:
            # a Matroska file would contain random numbers: the same pictures would not give the same bytes
            return _OpenCvWriter(below(folder, f"{name}.avi"), size_px, (cv2.CAP_FFMPEG, "FFV1"), rate_hz)
        case _:
            quality = _DEFAULT_JPEG_QUALITY if coding.quality is None else coding.quality
            path = below(folder, f"{name}.avi")
            return _OpenCvWriter(path, size_px, (cv2.CAP_OPENCV_MJPEG, "MJPG"), rate_hz, quality)


class _PngWriter:
    """A folder of numbered PNG files; a missing picture has no file."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self._folder = folder

    def __enter__(self) -> "_PngWriter":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        pass

    def write(self, number: int, image: ImageArray | None) -> None:
        if image is None:
            return
        path = below(self._folder, f"{number:06d}.png")
        good, encoded = cv2.imencode(".png", image)
        if not good:
            raise OSError(f"{path.name}: OpenCV cannot encode it")
        path.write_bytes(encoded.tobytes())


class _OpenCvWriter:
    """A video by OpenCV; a missing picture is black."""

    def __init__(
        self, path: Path, size_px: tuple[int, int], coder: tuple[int, str], rate_hz: float, quality: int | None = None
    ) -> None:
        backend, code = coder
        video = cv2.VideoWriter(str(path), backend, cv2.VideoWriter.fourcc(*code), rate_hz, size_px)
        if not video.isOpened():
            raise InputError(str(path), got=f"an OpenCV that does not write {code}", wanted="another --pictures")
        if quality is not None:
            video.set(cv2.VIDEOWRITER_PROP_QUALITY, quality)
        self._video = video
        self._size = size_px
        self._path, self._count = path, 0

    def __enter__(self) -> "_OpenCvWriter":
        return self

    def __exit__(self, *error: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._video.release()
        if error[0] is None:
            require_whole_video(self._path, self._count)

    def write(self, number: int, image: ImageArray | None) -> None:
        w, h = self._size
        self._video.write(np.zeros((h, w, 3), np.uint8) if image is None else image)
        self._count += 1


class _H264Writer:
    """An MP4 by PyAV's libx264 in one thread, so that the same pictures give the same bytes.

    A missing picture repeats the one before, which costs nothing and disturbs no later one.
    """

    def __init__(self, path: Path, size_px: tuple[int, int], crf: int, rate_hz: float) -> None:
        even = size_px[0] % 2 == 0 and size_px[1] % 2 == 0
        got = f"H.264 of {size_px[0]} × {size_px[1]} px"
        require(even, path.name, got=got, wanted="an even width and height, or another format")
        try:
            import av
        except ImportError as fault:
            raise NoVideoCoderError("PyAV", got="not installed", wanted="pip install 'groundstation[world]'") from fault
        self._av = av
        self._container = av.open(str(path), "w")
        options = {"crf": str(crf), "preset": "veryfast", "threads": "1", "bf": "0", "g": str(_KEY_EVERY)}
        rate = Fraction(rate_hz).limit_denominator(1000)
        stream: Any = self._container.add_stream("libx264", rate=rate, options=options)
        stream.width, stream.height = size_px
        stream.pix_fmt = "yuv420p"
        stream.thread_count = 1
        # the container may count its stream's stamps in finer ticks once its header is written
        self._tick = 1 / rate
        stream.codec_context.time_base = self._tick
        self._stream = stream
        self._last = np.zeros((size_px[1], size_px[0], 3), np.uint8)

    def __enter__(self) -> "_H264Writer":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._container.mux(self._stream.encode(None))
        self._container.close()

    def write(self, number: int, image: ImageArray | None) -> None:
        shown = self._last if image is None else image
        frame = self._av.VideoFrame.from_ndarray(shown, format="bgr24")
        frame.pts = number
        frame.time_base = self._tick
        self._container.mux(self._stream.encode(frame))
        self._last = shown
