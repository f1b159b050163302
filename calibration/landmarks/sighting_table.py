"""Sightings that are appended to their table as they are taken: a stop's rows are in it whole, or not at all."""

import csv
import fcntl
import io
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibration.sightings import SIGHTING_COLUMNS, LandmarkSighting, read_sightings
from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words

COLUMNS = (*SIGHTING_COLUMNS, "sigma_px", "t_s", "pan_from", "tilt_from")


class SightingTable:
    """A table that grows by the rows of one stop at a time; one that exists is continued.

    Two programs, one for each station, may append to the same file. Raises `InputError` for a file whose columns or
    last line do not permit another row, `SessionError` for a fault in its rows.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._own: list[LandmarkSighting] = []
        if path.exists() and path.stat().st_size:
            _require_appendable(path)
            self._own = list(read_sightings(path))

    @property
    def sightings(self) -> tuple[LandmarkSighting, ...]:
        """The rows that it had when it was opened, then those appended since."""
        return tuple(self._own)

    def rows_of(self, station: str, landmark: str) -> int:
        """Return the number of rows of a landmark seen from a station."""
        return len(self._of(station, landmark))

    def angles_of(self, station: str, landmark: str) -> FloatArray | None:
        """Return pan and tilt (2,), rad: the median of the rows of a landmark; None where it has none."""
        rows = self._of(station, landmark)
        if not rows:
            return None
        return np.asarray(np.median([(s.pan_rad, s.tilt_rad) for s in rows], axis=0))

    def append(self, rows: Sequence[LandmarkSighting]) -> None:
        """Append rows, and sync them to the disk; where that fails the file is as before. Raises `OSError`."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerows(_cells(row) for row in rows)
        data = text.getvalue().encode()
        descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            size = os.fstat(descriptor).st_size
            if size == 0:
                data = (",".join(COLUMNS) + "\n").encode() + data
            _write(descriptor, data, size)
        except OSError as fault:
            raise OSError(fault.errno, fault.strerror, str(self._path)) from fault
        finally:
            os.close(descriptor)
        self._own.extend(rows)

    def _of(self, station: str, landmark: str) -> list[LandmarkSighting]:
        return [s for s in self._own if s.station == station and s.landmark == landmark]


def _require_appendable(path: Path) -> None:
    """Raise `InputError` unless another row can follow the last one."""
    try:
        with path.open("rb") as stream:
            header = stream.readline(1024)
            stream.seek(-1, os.SEEK_END)
            last = stream.read(1)
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a table to append to") from fault
    columns = header.decode("utf-8-sig", errors="replace").strip()
    if columns != ",".join(COLUMNS):
        got = f"the columns {columns[:120]}" if columns else "no columns"
        raise InputError(f"{path}: line 1", got=got, wanted=f"{','.join(COLUMNS)}, or a new file")
    if last != b"\n":
        raise InputError(str(path), got="a last line without an end", wanted="that line complete, or removed")


def _write(descriptor: int, data: bytes, size: int) -> None:
    done = 0
    try:
        while done < len(data):
            done += os.write(descriptor, data[done:])
        os.fsync(descriptor)
    except BaseException:
        # an interrupt, too: no row remains in part
        os.ftruncate(descriptor, size)
        raise


def _cells(row: LandmarkSighting) -> tuple[str, ...]:
    pan, tilt = np.degrees([row.pan_rad, row.tilt_rad])
    return (
        row.station,
        row.landmark,
        f"{pan:.6f}",
        f"{tilt:.6f}",
        f"{row.pixel_px[0]:.4f}",
        f"{row.pixel_px[1]:.4f}",
        f"{row.sigma_px:.4f}",
        "" if row.t_s is None else f"{row.t_s:.4f}",
        str(row.pan_from) if row.pan_from else "",
        str(row.tilt_from) if row.tilt_from else "",
    )
