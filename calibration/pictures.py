"""The pictures that the user names: files, a folder, a video; read one at a time."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration.errors import IntrinsicsError
from groundstation.arrays import ImageArray
from groundstation.files.image_header import MAX_PICTURE_PX, coded_size_px, is_decodable
from groundstation.files.picture_depth import WANTED_DEPTH, shallow_levels

_PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp"})
_VIDEOS = frozenset({".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm"})
# a board moved by hand shows nothing new from one frame to the next
MOST_VIDEO_FRAMES = 300


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GreyPicture:
    """One picture: ``name`` for the user, ``grey`` (h, w)."""

    name: str
    grey: ImageArray


def read_pictures(sources: Sequence[Path]) -> Iterator[GreyPicture]:
    """Yield every picture of files, folders and videos, all of one size; a long video at even steps.

    Raises
    ------
    IntrinsicsError : a source is missing, holds no picture, cannot be decoded, or the sizes differ.
    """
    first: GreyPicture | None = None
    for picture in _all(sources):
        if first is None:
            first = picture
        if picture.grey.shape != first.grey.shape:
            raise IntrinsicsError(picture.name, got=_size(picture), wanted=f"{_size(first)}, as {first.name} has")
        yield picture


def _size(picture: GreyPicture) -> str:
    return f"{picture.grey.shape[1]}x{picture.grey.shape[0]} px"


def _all(sources: Sequence[Path]) -> Iterator[GreyPicture]:
    for source in sources:
        if source.is_dir():
            files = sorted(f for f in source.iterdir() if f.suffix.lower() in _PICTURES)
            if not files:
                raise IntrinsicsError(
                    str(source), got="a folder without pictures", wanted="PNG, JPEG, TIFF or BMP files"
                )
            for file in files:
                yield _picture(file)
        elif not source.is_file():
            raise IntrinsicsError(str(source), got="no such file", wanted="a picture, a folder of pictures or a video")
        elif source.suffix.lower() in _VIDEOS:
            yield from _video(source)
        else:
            yield _picture(source)


def _picture(path: Path) -> GreyPicture:
    data = path.read_bytes()
    size = coded_size_px(data)
    if size is not None and size[0] * size[1] > MAX_PICTURE_PX:
        wanted = f"at most {MAX_PICTURE_PX // 10**6} million pixels"
        raise IntrinsicsError(str(path), got=f"a picture of {size[0]}x{size[1]} px", wanted=wanted)
    grey = None
    if is_decodable(data):
        with contextlib.suppress(cv2.error):
            flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
            grey = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    if grey is None:
        raise IntrinsicsError(str(path), got="nothing that can be decoded", wanted="a picture")
    shallow = shallow_levels(data)
    if shallow is not None:
        raise IntrinsicsError(str(path), got=shallow, wanted=WANTED_DEPTH)
    return GreyPicture(name=path.name, grey=np.asarray(grey, dtype=np.uint8))


def _video(path: Path) -> Iterator[GreyPicture]:
    capture = cv2.VideoCapture(str(path))
    try:
        count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        step = max(1, -(-count // MOST_VIDEO_FRAMES))
        index = 0
        while capture.grab():
            if index % step == 0:
                ok, frame = capture.retrieve()
                if ok:
                    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) if frame.ndim == 3 else frame
                    yield GreyPicture(name=f"{path.name} frame {index}", grey=np.asarray(grey, dtype=np.uint8))
            index += 1
    finally:
        capture.release()
    if index == 0:
        raise IntrinsicsError(str(path), got="no frame that can be decoded", wanted="a video")
