"""The table of `--imu`: position and attitude over time, and a pose for any moment in it."""

import csv
import math
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.files.text_file import absence
from groundstation.files.toml_table import shown
from groundstation.onboard.edges.camera_file import NoseCamera
from groundstation.onboard.edges.pose import Attitude, NoseCameraPose, nose_pose, threshold_position

_ATTITUDE = ("roll_deg", "pitch_deg", "yaw_deg")
_EARTH = ("lat_deg", "lon_deg", "alt_m")
_LOCAL = ("x_m", "y_m", "z_m")
MAX_GAP_S = 0.5


class ImuFileError(InputError):
    """An IMU table is not usable."""


class PoseLog:
    """Poses of the camera over time.

    Parameters
    ----------
    t_s : (n,), growing. positions_m : (n, 3), threshold frame. attitude_rad : (n, 3) roll, pitch, yaw; yaw from the
        landing direction, without jumps of a full turn.
    """

    def __init__(self, t_s: FloatArray, positions_m: FloatArray, attitude_rad: FloatArray, mount: Attitude) -> None:
        self._t = t_s
        self._columns = np.hstack([positions_m, attitude_rad])
        self._mount = mount

    @property
    def span_s(self) -> tuple[float, float]:
        """Return the first and the last time."""
        return float(self._t[0]), float(self._t[-1])

    def pose(self, t_s: float) -> NoseCameraPose | None:
        """Return the pose at a time, in between linearly; None outside, and in gaps longer than `MAX_GAP_S`."""
        after = int(np.searchsorted(self._t, t_s))
        low, high = max(after - 1, 0), min(after, self._t.size - 1)
        nearest = min(abs(t_s - self._t[low]), abs(t_s - self._t[high]))
        outside = low == high or not self._t[0] <= t_s <= self._t[-1]
        if (outside and nearest > 1e-3) or (not outside and self._t[high] - self._t[low] > MAX_GAP_S):
            return None
        x, y, z, roll, pitch, yaw = (float(np.interp(t_s, self._t, column)) for column in self._columns.T)
        attitude = Attitude(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
        return nose_pose(np.array([x, y, z]), attitude, self._mount)


def load_imu(path: Path, camera: NoseCamera) -> PoseLog:
    """Read an IMU table; raises `ImuFileError`.

    Columns: t_s, roll_deg, pitch_deg, yaw_deg, and lat_deg, lon_deg, alt_m (the camera file's [runway] then gives
    the threshold) or x_m, y_m, z_m in the threshold frame. Others are ignored.
    """
    header, rows = _read(path)
    where = _LOCAL if set(_LOCAL) <= set(header) else _EARTH
    wanted = ("t_s", *_ATTITUDE, *where)
    missing = [name for name in wanted if name not in header]
    if missing:
        raise ImuFileError(
            str(path),
            got=f"no column {', '.join(missing)}",
            wanted="t_s, roll_deg, pitch_deg, yaw_deg, and lat_deg, lon_deg, alt_m or x_m, y_m, z_m",
        )
    if where is _EARTH and camera.place is None:
        raise ImuFileError(
            str(path), got="places on Earth", wanted="lat_deg, lon_deg and alt_m in the camera's [runway]"
        )
    table = np.array([[_number(path, line, row, header, name) for name in wanted] for line, row in rows])
    if len(table) < 2:
        counted = "one row" if len(table) else "no row"
        raise ImuFileError(str(path), got=counted, wanted="two or more, over the video's time")
    for (line, _), before, now in zip(rows[1:], table[:-1, 0], table[1:, 0], strict=True):
        if now <= before:
            raise ImuFileError(
                f"{path}: line {line}: t_s", got=f"{now:.15g} after {before:.15g}", wanted="growing times"
            )
    attitude = np.unwrap(np.radians(table[:, 1:4]), axis=0)
    attitude[:, 2] -= camera.heading_rad
    positions = table[:, 4:]
    if where is _EARTH and camera.place is not None:
        positions = np.array([threshold_position(lat, lon, alt, camera.place) for lat, lon, alt in positions])
    if np.any(positions[:, 2] <= 0.0):
        raise ImuFileError(str(path), got="a height at or below the threshold's", wanted="heights above it")
    return PoseLog(table[:, 0], positions, attitude, camera.mount)


def _read(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the header and the numbered rows."""
    if not path.is_file():
        raise ImuFileError(str(path), got=absence(path), wanted="a CSV table")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file))
    except UnicodeDecodeError as fault:
        raise ImuFileError(str(path), got="bytes that are no text in UTF-8", wanted="a CSV table") from fault
    except (OSError, csv.Error) as fault:
        raise ImuFileError(str(path), got=shown(os_words(fault)), wanted="a CSV table") from fault
    if not lines:
        raise ImuFileError(str(path), got="an empty file", wanted="a CSV table")
    header = [name.strip() for name in lines[0]]
    return header, [(n, row) for n, row in enumerate(lines[1:], start=2) if any(map(str.strip, row))]


def _number(path: Path, line: int, row: list[str], header: list[str], name: str) -> float:
    place = header.index(name)
    text = row[place] if place < len(row) else ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ImuFileError(f"{path}: line {line}: {name}", got=repr(shown(text)), wanted="a finite number")
    return value
