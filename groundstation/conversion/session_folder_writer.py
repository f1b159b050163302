"""Events as a plain session folder: tables in each device's own clock, pictures as PNG.

Numbers are written so that reading the folder gives every time and angle of the events again, bit for bit; angles that
are corrected by axes, to rounding.
"""

import math
from array import array
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.box import Box
from groundstation.conversion.device_records import DeviceRecords
from groundstation.errors import InputError, os_words
from groundstation.files.output_names import below
from groundstation.messages import (
    Event,
    FilterReset,
    Frame,
    FrameAngles,
    Heartbeat,
    PixelMeasurement,
    PtuSample,
    ReferenceFix,
)
from groundstation.picture import PartialPicture, Picture
from groundstation.session import Session
from groundstation.sources import frame_angles_table

# what colours at a kept part's border lean on beyond it, in px
_BORDER_PX = 4


@dataclass(slots=True, kw_only=True)
class WrittenCounts:
    """Contents of the folder, and counts of data that a folder cannot represent."""

    frames: int = 0
    partial: int = 0
    readings: int = 0
    pixels: int = 0
    out_of_order: int = 0
    references: int = 0
    heartbeats: int = 0
    resets: int = 0


class SessionFolderWriter:
    """Writes events into ``folder``, new or empty; `finish` writes the tables.

    Parameters
    ----------
    session : whose stations, and pictures or pixels, the events have.
    devices : gives the devices' stamps and readings of the events.

    Raises `InputError` if the folder cannot be written, or has something in it.
    """

    def __init__(self, folder: Path, session: Session, devices: DeviceRecords) -> None:
        self._folder = folder
        self._session = session
        self._devices = devices
        self._stations = session.rig.names
        self._rows: dict[int, dict[str, float]] = {}
        self._readings = {s.name: array("d") for s in session.rig.stations if not s.fixed}
        self._pixels: dict[str, list[tuple[float, ...]]] = {}
        self._angles: list[list[str]] = []
        self._angles_delayed = False
        self.done = WrittenCounts()
        with _writing(folder):
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise InputError(str(folder), got="a folder that is not empty", wanted="a new or an empty one")
            if not session.detections_only:
                for name in self._stations:
                    below(folder, name).mkdir()

    def take(self, event: Event) -> None:
        """Add one event; pictures are written at once."""
        if isinstance(event, PtuSample):
            t_s = self._devices.ptu_stamp(event.station, event.t_s)
            readings = self._devices.readings_deg(event.station, event.pan_rad, event.tilt_rad)
            self._readings[event.station].extend([t_s, *readings])
            self.done.readings += 1
        elif isinstance(event, Frame):
            self._frame(event)
        elif isinstance(event, PixelMeasurement):
            t_s = self._devices.camera_stamp(event.station, event.t_s)
            self._pixels.setdefault(event.station, []).append((t_s, event.u_px, event.v_px, *(event.sigma_px or ())))
            self.done.pixels += 1
        elif isinstance(event, FrameAngles):
            t_s = self._devices.camera_stamp(event.station, event.t_s)
            self._angles.append(
                [repr(t_s), event.station, *map(repr, (event.pan_rad, event.tilt_rad, event.sigma_rad, event.delay_s))]
            )
            self._angles_delayed |= event.delay_s != 0.0
        elif isinstance(event, ReferenceFix):
            self.done.references += 1
        elif isinstance(event, Heartbeat):
            self.done.heartbeats += 1
        elif isinstance(event, FilterReset):
            self.done.resets += 1

    def finish(self, files: Mapping[str, bytes], note: str) -> None:
        """Write the session's own files and the tables; ``note`` goes on top of session.toml as a remark."""
        with _writing(self._folder):
            for name, data in files.items():
                remark = f"# {note}\n".encode() if note and name == "session.toml" else b""
                # "x": the folder was empty, so that a name which is there already is one of ours, or a link
                _write_new(below(self._folder, name), remark + data.removeprefix(b"\xef\xbb\xbf"))
            if self._session.detections_only:
                self._write_pixels()
            else:
                self._table("frames.csv", ["index", *(f"{n}_t_s" for n in self._stations)], self._frame_rows())
            if self._angles:
                columns = [*frame_angles_table.COLUMNS, *([frame_angles_table.DELAY] if self._angles_delayed else [])]
                rows = [row[: len(columns)] for row in self._angles]
                self._table(frame_angles_table.NAME, columns, rows)
            if self._readings:
                columns = [f"{n}_{axis}_deg" for n in self._readings for axis in ("pan", "tilt")]
                self._table("ptu.csv", ["t_s", *columns], self._reading_rows())

    def _frame(self, frame: Frame) -> None:
        stamps = self._rows.setdefault(frame.epoch, {})
        if frame.station in stamps:
            self.done.out_of_order += 1
            return
        stamps[frame.station] = self._devices.camera_stamp(frame.station, frame.t_s)
        image, whole = _whole_or_black(frame.image)
        self.done.frames += 1
        self.done.partial += not whole
        path = below(below(self._folder, frame.station), f"{frame.epoch:06d}.png")
        with _writing(self._folder):
            _write_new(path, cv2.imencode(".png", image, (cv2.IMWRITE_PNG_COMPRESSION, 1))[1].tobytes())

    def _frame_rows(self) -> Iterable[list[str]]:
        """Return the rows of frames.csv; a stamp that does not grow is left out, as a folder cannot have it."""
        newest = dict.fromkeys(self._stations, -math.inf)
        for epoch in sorted(self._rows):
            cells = [str(epoch)]
            for name in self._stations:
                t_s = self._rows[epoch].get(name)
                if t_s is not None and t_s <= newest[name]:
                    self.done.out_of_order += 1
                    t_s = None
                newest[name] = newest[name] if t_s is None else t_s
                cells.append("" if t_s is None else repr(t_s))
            yield cells

    def _reading_rows(self) -> Iterable[list[str]]:
        """Return the rows of ptu.csv; units whose stamps are the same share one."""
        tables = {n: np.array(v, np.float64).reshape(-1, 3) for n, v in self._readings.items()}
        by_time: dict[str, dict[float, tuple[float, float]]] = {
            n: {float(t): (float(pan), float(tilt)) for t, pan, tilt in rows} for n, rows in tables.items()
        }
        self.done.out_of_order += sum(len(tables[n]) - len(by_time[n]) for n in tables)
        for t_s in sorted(set().union(*by_time.values())):
            cells = [repr(t_s)]
            for rows in by_time.values():
                angles = rows.get(t_s)
                cells += ["", ""] if angles is None else [repr(angle) for angle in angles]
            yield cells

    def _write_pixels(self) -> None:
        """Write detections.csv, with columns of sigma where any pixel carries its own."""
        sigmas = any(len(row) > 3 for rows in self._pixels.values() for row in rows)
        columns = ["t_s", "station", "u_px", "v_px", *(("sigma_u_px", "sigma_v_px") if sigmas else ())]
        self._table("detections.csv", columns, self._pixel_rows(len(columns)))

    def _pixel_rows(self, width: int) -> Iterable[list[str]]:
        for name, rows in self._pixels.items():
            newest = -math.inf
            for t_s, *values in sorted(rows):
                if t_s > newest:
                    cells = [repr(t_s), name, *map(repr, values)]
                    yield cells + [""] * (width - len(cells))
                else:
                    self.done.out_of_order += 1
                newest = max(newest, t_s)

    def _table(self, name: str, columns: list[str], rows: Iterable[list[str]]) -> None:
        _write_new(below(self._folder, name), "".join(",".join(cells) + "\n" for cells in (columns, *rows)).encode())


def _write_new(path: Path, data: bytes) -> None:
    """Write a file that is not there yet; a full disk or an interrupt leaves none rather than half of it."""
    with path.open("xb") as file:
        try:
            file.write(data)
            file.flush()
        except BaseException:
            path.unlink()
            raise


class _writing:  # noqa: N801 - reads as what it is: with _writing(folder)
    """Converts an `OSError` of the folder to `InputError`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, fault: BaseException | None, trace: object) -> None:
        if isinstance(fault, OSError):
            raise InputError(str(self._folder), got=os_words(fault), wanted="a folder to write to") from fault


def _whole_or_black(picture: Picture) -> tuple[ImageArray, bool]:
    """Return a picture in colour, black where it was not kept, and whether all of it was."""
    w, h = picture.size_px
    if not isinstance(picture, PartialPicture):
        return picture.whole(), True
    if picture.has_all:
        return picture.whole(), True
    image = np.zeros((h, w, 3), np.uint8)
    for window in picture.recorded_windows:
        inner = window if picture.pattern is None else _inner(window, picture.size_px)
        if inner.w > 0 and inner.h > 0:
            pixels, (x, y) = picture.window(inner)
            image[y : y + pixels.shape[0], x : x + pixels.shape[1]] = pixels
    return image, False


def _inner(window: Box[int], size_px: tuple[int, int]) -> Box[int]:
    """Return the part of a raw window whose colours do not lean on what lies outside it."""
    x0, y0 = (v + _BORDER_PX if v else 0 for v in window[:2])
    x1, y1 = (v - _BORDER_PX if v < size else v for v, size in zip(window[2:], size_px, strict=True))
    return Box(x0, y0, x1, y1)
