"""Decoding of one station's pictures in a separate thread, a bounded number of frames ahead."""

import queue
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType

import cv2
import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import ImageArray
from groundstation.errors import SessionError
from groundstation.files.toml_table import shown
from groundstation.session import Medium, MediumKind
from groundstation.session.media import image_files, open_video, read_image, size_fault
from groundstation.sources.frame_pool import FramePool
from groundstation.sources.video_seek import seek
from groundstation.thread_scheduling import give_way

QUEUE_FRAMES = 6
# forward decoding of so few frames is as quick as a seek
SEEK_BEYOND = 200

__all__ = ["DecodedFrame", "PictureReader", "image_files"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DecodedFrame:
    """One decoded frame: its number in the medium and its pixels (h, w, 3) uint8 BGR."""

    index: int
    image: ImageArray


class PictureReader:
    """Delivers the frames of the given numbers in order, decoded ahead in a thread.

    Parameters
    ----------
    indices : (n,) increasing frame numbers.
    lines : (n,) the line of frames.csv of each, for error messages.
    size_px : (w, h) from the rig.
    listed : how many frames the medium holds by frames.csv; as many as are asked for where it is not given.
    whole : more frames than that are a fault.

    Use it as a context manager: the thread is always joined.
    """

    def __init__(
        self,
        medium: Medium,
        indices: NDArray[np.int64],
        lines: NDArray[np.int64],
        size_px: tuple[int, int],
        *,
        listed: int | None = None,
        whole: bool,
    ) -> None:
        self._medium = medium
        self._indices = indices
        self._lines = lines
        self._size = size_px
        self._listed = int(indices[-1]) + 1 if listed is None and len(indices) else listed or 0
        self._whole = whole
        self._queue: queue.Queue[DecodedFrame | SessionError | None] = queue.Queue(maxsize=QUEUE_FRAMES)
        self._pool = FramePool(size_px)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name=f"decode-{medium.path.name}", daemon=True)

    def __enter__(self) -> "PictureReader":
        self._thread.start()
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._stop.set()
        while self._thread.is_alive():
            try:
                self._queue.get_nowait()
            except queue.Empty:
                self._thread.join(timeout=0.02)

    def next(self) -> DecodedFrame | None:
        """Return the next picture, None after the last; raises `SessionError` for a fault of the medium."""
        item = self._queue.get()
        if isinstance(item, SessionError):
            raise item
        return item

    # ------------------------------------------------------------------------------------ the thread
    def _work(self) -> None:
        give_way()
        try:
            video = self._medium.kind is MediumKind.VIDEO
            if len(self._indices):
                for picture in self._decode_video() if video else self._read_images():
                    self._put(picture)
            self._put(None)
        except SessionError as fault:
            self._put(fault)
        except Exception as error:  # noqa: BLE001 - a decoder may raise anything; it must reach the consumer
            got = shown(f"{type(error).__name__}: {error}", 200)
            self._put(self._fault(got, "pictures that OpenCV can decode"))

    def _put(self, item: DecodedFrame | SessionError | None) -> None:
        while not self._stop.is_set():
            try:
                self._queue.put(item, timeout=0.1)
            except queue.Full:
                continue
            return

    def _fault(self, got: str, wanted: str, where: str = "") -> SessionError:
        return SessionError(f"{self._medium.path.name}{where}", got=got, wanted=wanted)

    def _checked(self, decoded: object, index: int, line: int) -> DecodedFrame:
        """Return the picture, or raise if it is missing or its size differs from the rig's."""
        if not isinstance(decoded, np.ndarray):
            wanted = f"a picture for frames.csv line {line}"
            raise self._fault("bytes that cannot be decoded", wanted, f": frame {index}")
        image = np.asarray(decoded, dtype=np.uint8)
        if image.ndim == 2:
            image = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
        if (image.shape[1], image.shape[0]) != self._size:
            size = (image.shape[1], image.shape[0])
            raise size_fault(f"{self._medium.path.name}: frame {index}", size, self._size)
        return DecodedFrame(index=index, image=image)

    def _decode_video(self) -> Iterator[DecodedFrame]:
        capture = open_video(self._medium.path)
        try:
            if not capture.isOpened():
                raise self._fault("no video that OpenCV can open", "a complete video file")
            place = 0
            first = int(self._indices[0])
            if first >= SEEK_BEYOND:
                if seek(capture, self._medium.path, first):
                    place = first
                else:
                    capture.release()
                    capture = open_video(self._medium.path)
            for number, line in zip(self._indices, self._lines, strict=True):
                index = int(number)
                while place < index:
                    if self._stop.is_set():
                        return
                    if not capture.grab():
                        raise self._ended(capture, place)
                    place += 1
                # a video of another size than the rig's gets separate memory, and is refused
                good, decoded = capture.read(self._pool.take())
                if not good:
                    raise self._ended(capture, place)
                place += 1
                yield self._checked(decoded, index, line)
                if self._stop.is_set():
                    return
            if self._whole and capture.grab():
                in_file = max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), place + 1)
                raise self._fault(f"{in_file} frames", f"{self._listed} frames as listed in frames.csv")
        finally:
            capture.release()

    def _ended(self, capture: cv2.VideoCapture, place: int) -> SessionError:
        """Build the error for a video that gives no more frames."""
        announced = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        damaged = f" of the {announced} that its header announces" if announced > place else ""
        got = f"the end of the video after {place} frames{damaged}"
        return self._fault(got, f"{self._listed} frames as listed in frames.csv", f": frame {place}")

    def _read_images(self) -> Iterator[DecodedFrame]:
        files = image_files(self._medium.path)
        for number, line in zip(self._indices, self._lines, strict=True):
            if self._stop.is_set():
                return
            index = int(number)
            path = files.get(index)
            if path is None:
                raise self._fault(f"no picture number {index}", f"{index:06d}.png for frames.csv line {line}")
            yield self._checked(read_image(path), index, line)
        if self._whole and max(files) >= self._listed:
            wanted = f"{self._listed} pictures as listed in frames.csv"
            raise self._fault(f"a picture {files[max(files)].name}", wanted)
