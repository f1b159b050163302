"""The pictures of a session: which medium each station has, and whether it fits the rig."""

import errno
import itertools
import os
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np

from groundstation.errors import InputError, SessionError
from groundstation.files.image_header import IMAGE_SUFFIXES, MAX_PICTURE_PX, is_decodable
from groundstation.files.matroska_tables import repeats_tables
from groundstation.files.picture_depth import WANTED_DEPTH, shallow_levels
from groundstation.files.text_file import absence, is_other_kind
from groundstation.files.toml_table import shown
from groundstation.rig.rig import Rig
from groundstation.rig.rig_limits import size_relation

# two of these for one station are ambiguous, which is an error
VIDEO_SUFFIXES = (".mp4", ".avi", ".mkv", ".mov", ".m4v", ".mpg", ".mpeg", ".ts", ".mts", ".webm", ".wmv")
# files that are no videos, but that FFmpeg may open: it draws text, and whatever is called .bin, as a terminal would
TEXT_SUFFIXES = (
    *(".csv", ".toml", ".txt", ".json", ".npz", ".md", ".srt", ".xml", ".html", ".log"),
    *(".bin", ".ans", ".nfo"),
)
# how coded pictures are decoded: rows as they lie there, whatever EXIF says of how the camera was held
IN_COLOUR = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
# a day at 100 Hz, and far from filling the memory with names
_MAX_FILES = 10_000_000


class MediumKind(StrEnum):
    """Kind of a station's source of pictures."""

    VIDEO = "video"
    IMAGES = "images"
    RECORDING = "recording"


@dataclass(frozen=True, slots=True, kw_only=True)
class Medium:
    """One station's pictures: a video file, a folder of 000000.png …, or a recording that holds them."""

    kind: MediumKind
    path: Path


def find_media(folder: Path, rig: Rig) -> dict[str, Medium]:
    """Return each station's pictures; empty for a session of detections only.

    Raises `SessionError` if a station has no pictures, or two videos.
    """
    found = {name: medium for name in rig.names if (medium := _medium(folder, name)) is not None}
    has_frames, has_labels = (folder / "frames.csv").is_file(), (folder / "detections.csv").is_file()
    if has_labels and not (has_frames and found):
        return {}
    if not has_frames:
        if is_other_kind(folder / "frames.csv"):
            raise SessionError(str(folder / "frames.csv"), got=absence(folder / "frames.csv"), wanted="a table")
        got = "pictures without frames.csv" if found else "neither of them"
        raise SessionError(str(folder), got=got, wanted="frames.csv with videos, or detections.csv")
    for name in rig.names:
        if name not in found:
            wanted = f"{name}.mp4 (or another video) or a folder {name}/ of 000000.png …"
            got = f"no pictures of station {name}{_dead_link(folder, name)}"
            raise SessionError(str(folder), got=got, wanted=wanted)
    _require_own_videos(found)
    return found


def _dead_link(folder: Path, name: str) -> str:
    """Return in brackets which link of a station's name leads nowhere; nothing if there is none."""
    links = [f for f in sorted(folder.glob(f"{name}*")) if f.stem == name and f.is_symlink() and not f.exists()]
    return f" ({links[0].name} is a link to {shown(str(links[0].readlink()))}, which is not there)" if links else ""


def _require_own_videos(media: Mapping[str, Medium]) -> None:
    """Raise `SessionError` if two stations have one video, by links. Copies are told by their pictures' motion."""
    videos = {name: medium.path for name, medium in media.items() if medium.kind is MediumKind.VIDEO}
    for (first, one), (second, other) in itertools.combinations(videos.items(), 2):
        if one.samefile(other):
            got = f"one file for {first} and {second}"
            raise SessionError(f"{one.name}, {other.name}", got=got, wanted="each station's own video")


def _medium(folder: Path, name: str) -> Medium | None:
    """Return a station's video, otherwise its folder of pictures."""
    files = [f for f in sorted(folder.glob(f"{name}.*")) if f.stem == name and f.is_file()]
    videos = [f for f in files if f.suffix.lower() in VIDEO_SUFFIXES]
    if len(videos) > 1:
        got = " and ".join(f.name for f in videos[:2])
        raise SessionError(str(folder), got=got, wanted=f"one video for station {name}")
    if videos:
        return Medium(kind=MediumKind.VIDEO, path=videos[0])
    if (folder / name).is_dir():
        return Medium(kind=MediumKind.IMAGES, path=folder / name)
    # any other extension, if OpenCV can read it
    others = (f for f in files if f.suffix.lower() not in TEXT_SUFFIXES and open_video(f).isOpened())
    path = next(others, None)
    return None if path is None else Medium(kind=MediumKind.VIDEO, path=path)


def require_readable(path: Path, where: str, error: type[InputError]) -> None:
    """Raise ``error`` for a file that the user may not read, of which OpenCV says nothing."""
    if path.exists() and not os.access(path, os.R_OK):
        raise error(where, got=os.strerror(errno.EACCES), wanted="a file that can be read")


def open_video(path: Path) -> cv2.VideoCapture:
    """Open a video for decoding in one thread; `isOpened` reports success."""
    if repeats_tables(path):
        return cv2.VideoCapture()
    # FFmpeg alone: OpenCV's other readers would take a name with digits for a series of images. The cameras
    # already decode side by side; more threads each would only hold more frames in memory.
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    # size in its header, before memory is allocated for a picture
    if capture.get(cv2.CAP_PROP_FRAME_WIDTH) * capture.get(cv2.CAP_PROP_FRAME_HEIGHT) > MAX_PICTURE_PX:
        capture.release()
    return capture


def open_packets(path: Path) -> cv2.VideoCapture:
    """Open a video for its coded frames, in the order of coding, without decoding them."""
    if repeats_tables(path):
        return cv2.VideoCapture()
    return cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])


def image_files(folder: Path) -> dict[int, Path]:
    """Return the folder's pictures by their number; files with other names are ignored.

    Raises `SessionError` if two files have the same number.
    """
    files: dict[int, Path] = {}
    for count, path in enumerate(folder.iterdir()):
        if count >= _MAX_FILES:
            raise SessionError(folder.name, got="more files", wanted=f"at most {_MAX_FILES}")
        if path.suffix.lower() in IMAGE_SUFFIXES and path.stem.isascii() and path.stem.isdigit():
            number = int(path.stem[-18:])
            if number in files:
                got = " and ".join(sorted((files[number].name, path.name)))
                raise SessionError(folder.name, got=got, wanted=f"one picture with the number {number}")
            files[number] = path
    return files


def read_image(path: Path) -> object:
    """Return a picture (h, w, 3) uint8 BGR, or None if it cannot be read or is truncated.

    Its rows are those of the file, as calibrations take them, however a viewer is told to turn it.
    """
    try:
        encoded = path.read_bytes()
    except OSError:
        return None
    # a truncated JPEG is decoded without an error, the rest grey; only its end marker shows it
    if path.suffix.lower() in (".jpg", ".jpeg") and encoded.find(b"\xff\xd9", len(encoded) // 2) < 0:
        return None
    if not is_decodable(encoded):
        return None
    try:
        return cv2.imdecode(np.frombuffer(encoded, dtype=np.uint8), IN_COLOUR)
    except cv2.error:
        return None


def check_medium(medium: Medium, size_px: tuple[int, int]) -> None:
    """Open a medium and compare its pictures' size with the rig's (w, h). Raises `SessionError`."""
    if medium.kind is MediumKind.VIDEO:
        where, size = medium.path.name, _video_size(medium.path)
    else:
        where, size = _first_picture(medium.path)
    if size != size_px:
        raise size_fault(where, size, size_px)


def size_fault(where: str, size: tuple[int, int], wanted: tuple[int, int]) -> SessionError:
    """Build (not raise) the error for pictures of another size (w, h) than the rig's."""
    text = f"{wanted[0]}×{wanted[1]} px as in the rig"
    return SessionError(where, got=f"{size[0]}×{size[1]} px", wanted=text + size_relation(size, wanted))


def _video_size(path: Path) -> tuple[int, int]:
    require_readable(path, path.name, SessionError)
    capture = open_video(path)
    try:
        if not capture.isOpened():
            raise SessionError(path.name, got="no video that OpenCV can open", wanted="a complete video file")
        if not capture.grab():
            raise SessionError(path.name, got="a video without frames", wanted="a video with frames")
        return int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    finally:
        capture.release()


def _first_picture(folder: Path) -> tuple[str, tuple[int, int]]:
    """Return name and size (w, h) of the picture with the lowest number."""
    files = image_files(folder)
    if not files:
        raise SessionError(f"{folder.name}/", got="no picture", wanted="000000.png, 000001.png …")
    path = files[min(files)]
    where = f"{folder.name}/{path.name}"
    image = read_image(path)
    if not isinstance(image, np.ndarray):
        raise SessionError(where, got="bytes that cannot be decoded", wanted="a picture")
    shallow = shallow_levels(path.read_bytes())
    if shallow is not None:
        raise SessionError(where, got=shallow, wanted=WANTED_DEPTH)
    return where, (image.shape[1], image.shape[0])
