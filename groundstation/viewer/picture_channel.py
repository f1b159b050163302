"""One station's pictures in a Rerun recording where no video of it can go in whole: an encoded image for each frame.

They are sent a few megabytes at a time, and take a bounded room: of a long session each second, third … picture.
"""

from pathlib import Path

import cv2
import numpy as np
import rerun as rr

from groundstation.arrays import ImageArray
from groundstation.errors import SessionError, os_words
from groundstation.messages import CameraReport
from groundstation.viewer import entity_paths
from groundstation.viewer.columns import ColumnBatch
from groundstation.viewer.media import MEDIA_TYPES, ImageFolder

# of one station; two of them a viewer still opens with ease, in a browser as well
MAX_PICTURE_BYTES = 500_000_000
# rows wait for so much of them: few large pieces, and yet little memory
_SENT_AT_BYTES = 4_000_000
_JPEG, _JPEG_QUALITY = "image/jpeg", 75
# a first picture may be smaller than those that come
_MARGIN = 1.5


class PictureChannel:
    """Collects one station's pictures and hands them over as columns.

    Parameters
    ----------
    folder : pictures on disk, which go in as they lie there; without one those of the reports, as JPEG.
    expected : how many frames will come, 0 if that is not known; of too many each n-th is shown.
    """

    def __init__(self, station: str, folder: ImageFolder | None = None, expected: int = 0) -> None:
        self._station = station
        self._folder = folder
        self._expected = expected
        self._every = 1
        self._room = MAX_PICTURE_BYTES
        self._t_s: list[float] = []
        self._blobs: list[bytes] = []
        self._kinds: list[str] = []
        self._waiting = 0
        self._started = False
        self.notices: list[str] = []
        if folder is not None and folder.files:
            whole = sum(path.stat().st_size for path in folder.files.values() if path.is_file())
            self._thin(whole, len(folder.files))

    @property
    def from_reports(self) -> bool:
        """Whether the pictures have to come with the reports."""
        return self._folder is None

    @property
    def full(self) -> bool:
        """Whether enough is waiting to be taken."""
        return self._waiting >= _SENT_AT_BYTES

    def add(self, report: CameraReport) -> None:
        """Take a report's picture; raises `SessionError` where it should lie on disk and does not."""
        if self._folder is not None:
            path = self._folder.files.get(report.epoch)
            if path is not None and self._shown(report.epoch):
                self._keep(report.t_s, *encoded_file(path))
        elif report.image is not None and self._shown(report.epoch):
            self.add_picture(report.t_s, report.epoch, report.image.preview())

    def add_picture(self, t_s: float, number: int, picture: ImageArray) -> None:
        """Take frame ``number``, (h, w, 3) BGR."""
        if not self._shown(number):
            return
        jpeg = jpeg_bytes(picture)
        if not self._started:
            self._started = True
            self._thin(round(_MARGIN * len(jpeg) * self._expected), self._expected)
        self._keep(t_s, jpeg, _JPEG)

    def take(self) -> list[ColumnBatch]:
        """Return the pictures since the last call and forget them."""
        if not self._t_s:
            return []
        columns = rr.EncodedImage.columns(
            blob=[np.frombuffer(blob, np.uint8) for blob in self._blobs], media_type=self._kinds
        )
        batch = ColumnBatch(entity=entity_paths.image(self._station), t_s=np.array(self._t_s), columns=columns)
        self._t_s, self._blobs, self._kinds, self._waiting = [], [], [], 0
        return [batch]

    def _shown(self, number: int) -> bool:
        return self._room > 0 and number % self._every == 0

    def _thin(self, whole_bytes: int, count: int) -> None:
        """Leave out pictures where all of them would not have room."""
        self._every = max(1, -(-whole_bytes // MAX_PICTURE_BYTES))
        if self._every > 1:
            self.notices.append(f"one picture in {self._every} of {self._station}: there are {count}")

    def _keep(self, t_s: float, blob: bytes, kind: str) -> None:
        self._t_s.append(t_s)
        self._blobs.append(blob)
        self._kinds.append(kind)
        self._waiting += len(blob)
        self._room -= len(blob)
        if self._room <= 0:
            room = f"{MAX_PICTURE_BYTES / 1e6:g} MB"
            self.notices.append(f"no more pictures of {self._station}: they take {room} already")


def encoded_file(path: Path) -> tuple[bytes, str]:
    """Return a picture as it lies on disk, and its media type; raises `SessionError` if it is missing or another."""
    media_type = MEDIA_TYPES.get(path.suffix.lower())
    if media_type is None:
        raise SessionError(str(path), got=f"a {path.suffix} file", wanted="a JPEG or PNG picture")
    try:
        return path.read_bytes(), media_type
    except OSError as fault:
        raise SessionError(str(path), got=os_words(fault), wanted="a readable picture") from fault


def jpeg_bytes(picture: ImageArray) -> bytes:
    """Return a picture (h, w, 3) BGR for a person's eyes; pixels are measured before, not in this."""
    _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return jpeg.tobytes()


def jpeg_image(picture: ImageArray) -> rr.EncodedImage:
    """Return the same as one image to log."""
    return rr.EncodedImage(contents=jpeg_bytes(picture), media_type=_JPEG)
