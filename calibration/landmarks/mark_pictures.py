"""Pictures of a station's landmarks: what a user looks at to pick a pixel, and what a mark is registered with later.

In a station's folder: ``looks/NAME.png`` the newest whole picture, ``crops/NAME.png`` a part of it enlarged,
``marks/NAME.png`` the picture in which the mark's pixel is known, and ``marks.csv`` with these pixels.
"""

import csv
import hashlib
import io
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from calibration.landmarks.mark_registration import MarkReference
from groundstation.arrays import FloatArray, ImageArray
from groundstation.box import Box, clip
from groundstation.errors import InputError
from groundstation.files.csv_table import CsvTable
from groundstation.files.output_names import below
from groundstation.files.png_file import png_size_px
from groundstation.files.whole_file import write_bytes_whole, write_text_whole

_COLUMNS = ("landmark", "u_px", "v_px", "sha256")
_DIGITS = 16
_MAX_MARKS = 10_000
# a PNG is never longer than its pixels and a little
_MAX_FILE_SHARE = 4
_ENLARGED = 8
_CROP_PX = (96, 72)
_MARGIN = (56, 28)
_EVERY_PX = 10
_INK, _PAPER, _LINES = (255, 255, 255), (0, 0, 0), (0, 200, 200)


class MarkPictures:
    """One station's pictures; their folder is made at the first.

    Parameters
    ----------
    folder : of all stations; each has one in it.
    size_px : width and height of the camera's pictures.
    landmarks : all names that may come, which are names of files here.

    Raises `SessionError` for a damaged ``marks.csv``, `InputError` for a name that no file can have.
    """

    def __init__(self, folder: Path, station: str, size_px: tuple[int, int], landmarks: Iterable[str]) -> None:
        for name in landmarks:
            below(folder, f"{name}.png")
        self._folder, self._size_px = below(folder, station), size_px
        self._marks: dict[str, tuple[float, float, str]] = {}
        table = self._folder / "marks.csv"
        if table.exists():
            self._marks = _read(table)

    def reference(self, landmark: str) -> MarkReference | None:
        """Return the picture in which a landmark's pixel is known; None without one, or if its file has changed."""
        known = self._marks.get(landmark)
        if known is None:
            return None
        u, v, digest = known
        path = below(self._folder / "marks", f"{landmark}.png")
        w, h = self._size_px
        if not path.is_file() or path.stat().st_size > _MAX_FILE_SHARE * w * h + 65_536:
            return None
        data = path.read_bytes()
        if _digest(data) != digest or png_size_px(data) != self._size_px:
            return None
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            return None
        return MarkReference(image=np.asarray(image, dtype=np.uint8), pixel_px=np.array([u, v]))

    def keep(self, landmark: str, reference: MarkReference) -> Path:
        """Keep a picture with its known pixel, and return its path; raises `InputError`."""
        data = _png(reference.image)
        path = below(self._folder / "marks", f"{landmark}.png")
        # the digest in the table tells which of the two was not written, after an interrupt between them
        write_bytes_whole(path, data)
        u, v = (float(c) for c in reference.pixel_px)
        self._marks[landmark] = (u, v, _digest(data))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(_COLUMNS)
        writer.writerows((name, f"{u:.4f}", f"{v:.4f}", sha) for name, (u, v, sha) in self._marks.items())
        write_text_whole(self._folder / "marks.csv", text.getvalue())
        return path

    def show(self, landmark: str, image: ImageArray, centre_px: FloatArray) -> tuple[Path, Path]:
        """Write the whole picture, and the part around a pixel (2,) enlarged; returns their paths."""
        look = below(self._folder / "looks", f"{landmark}.png")
        crop = below(self._folder / "crops", f"{landmark}.png")
        write_bytes_whole(look, _png(image))
        write_bytes_whole(crop, _png(enlarged(image, centre_px)))
        return look, crop


def enlarged(image: ImageArray, centre_px: FloatArray) -> ImageArray:
    """Return the part of a picture around a pixel, each pixel 8 wide, with a scale of u above and of v to the left."""
    h, w = image.shape[:2]
    across, down = _CROP_PX
    x = int(np.clip(round(float(centre_px[0])) - across // 2, 0, max(w - across, 0)))
    y = int(np.clip(round(float(centre_px[1])) - down // 2, 0, max(h - down, 0)))
    part = clip(Box(x, y, x + across, y + down), (w, h))
    if part is None:
        raise InputError("the picture", got=f"{w} × {h} px", wanted="a picture with pixels")
    size = (part.w * _ENLARGED, part.h * _ENLARGED)
    pixels = cv2.resize(image[part.slices], size, interpolation=cv2.INTER_NEAREST)
    left, top = _MARGIN
    page = np.full((size[1] + top, size[0] + left, 3), _PAPER, np.uint8)
    page[top:, left:] = pixels
    for u in range(-(-part.x0 // _EVERY_PX) * _EVERY_PX, part.x1, _EVERY_PX):
        # a pixel's centre has integer coordinates
        column = left + (u - part.x0) * _ENLARGED + _ENLARGED // 2
        cv2.line(page, (column, top - 6), (column, top), _LINES, 1)
        cv2.putText(page, str(u), (column - 14, top - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.4, _INK, 1, cv2.LINE_AA)
    for v in range(-(-part.y0 // _EVERY_PX) * _EVERY_PX, part.y1, _EVERY_PX):
        row = top + (v - part.y0) * _ENLARGED + _ENLARGED // 2
        cv2.line(page, (left - 6, row), (left, row), _LINES, 1)
        cv2.putText(page, str(v), (6, row + 4), cv2.FONT_HERSHEY_SIMPLEX, 0.4, _INK, 1, cv2.LINE_AA)
    return page


def _read(path: Path) -> dict[str, tuple[float, float, str]]:
    table = CsvTable(path, _COLUMNS)
    marks: dict[str, tuple[float, float, str]] = {}
    for row in table:
        if len(marks) == _MAX_MARKS:
            raise table.fault(row.line, got="one more row", wanted=f"at most {_MAX_MARKS} marks")
        marks[row.text["landmark"]] = (table.number(row, "u_px"), table.number(row, "v_px"), row.text["sha256"])
    return marks


def _png(image: ImageArray) -> bytes:
    return bytes(cv2.imencode(".png", image)[1].tobytes())


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:_DIGITS]
