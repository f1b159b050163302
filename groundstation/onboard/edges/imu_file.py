"""The table of `--imu`: position and attitude over time, and a pose for any moment in it."""

import csv
import math
from dataclasses import dataclass
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
# a time that is a row's, as written
_AT_A_ROW_S = 1e-3


class ImuFileError(InputError):
    """An IMU table is not usable."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RefusedRows:
    """Rows of a table that are not used: how many, and the line of the first."""

    count: int
    first_line: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoggedPose:
    """A row of a log: its time and the camera's pose."""

    t_s: float
    pose: NoseCameraPose


class PoseLog:
    """Poses of the camera over time.

    Parameters
    ----------
    t_s : (n,), growing. positions_m : (n, 3), threshold frame. attitude_rad : (n, 3) roll, pitch, yaw; yaw from the
        landing direction, without jumps of a full turn. refused : rows of the table that it has not.
    """

    def __init__(
        self,
        t_s: FloatArray,
        positions_m: FloatArray,
        attitude_rad: FloatArray,
        mount: Attitude,
        refused: RefusedRows | None = None,
    ) -> None:
        self._t = t_s
        self._columns = np.hstack([positions_m, attitude_rad])
        self._mount = mount
        self.refused = refused

    @property
    def span_s(self) -> tuple[float, float]:
        """Return the first and the last time."""
        return float(self._t[0]), float(self._t[-1])

    @property
    def has_gaps(self) -> bool:
        """Return whether rows are farther apart than `MAX_GAP_S` anywhere."""
        return bool(np.diff(self._t).max(initial=0.0) > MAX_GAP_S)

    def covers(self, t_s: float) -> bool:
        """Return whether a time is between the first and the last row, or at one of them."""
        first_s, last_s = self.span_s
        return first_s - _AT_A_ROW_S <= t_s <= last_s + _AT_A_ROW_S

    def pose(self, t_s: float) -> NoseCameraPose | None:
        """Return the pose at a row, or between rows linearly; None outside, and in gaps longer than `MAX_GAP_S`."""
        if not self.covers(t_s):
            return None
        low, high = self._around(t_s)
        if self._off_s(t_s) > _AT_A_ROW_S and self._t[high] - self._t[low] > MAX_GAP_S:
            return None
        return self._between(t_s)

    def before(self, t_s: float) -> LoggedPose:
        """Return the last row that is not after a time; the first one where all are."""
        row_s = float(self._t[max(int(np.searchsorted(self._t, t_s + _AT_A_ROW_S)) - 1, 0)])
        return LoggedPose(t_s=row_s, pose=self._between(row_s))

    def in_gap(self, t_s: float) -> tuple[NoseCameraPose, NoseCameraPose] | None:
        """Return the pose in a gap, linearly, and that of the nearest row; None if that is `MAX_GAP_S` away."""
        if not self.covers(t_s) or self._off_s(t_s) > MAX_GAP_S:
            return None
        nearest = self._t[np.argmin(np.abs(self._t - t_s))]
        return self._between(t_s), self._between(float(nearest))

    def _around(self, t_s: float) -> tuple[int, int]:
        """Return the rows before and after a time, as far as there are."""
        after = int(np.searchsorted(self._t, t_s))
        return max(after - 1, 0), min(after, self._t.size - 1)

    def _off_s(self, t_s: float) -> float:
        """Return how far the nearest row is from a time."""
        return float(np.abs(self._t[list(self._around(t_s))] - t_s).min())

    def _between(self, t_s: float) -> NoseCameraPose:
        x, y, z, roll, pitch, yaw = (float(np.interp(t_s, self._t, column)) for column in self._columns.T)
        attitude = Attitude(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
        return nose_pose(np.array([x, y, z]), attitude, self._mount)


def refused_line(log: PoseLog | None, path: Path | None) -> tuple[str, ...]:
    """Return in a line for the user which rows of a log are not used; none where all are."""
    if log is None or path is None or log.refused is None:
        return ()
    rows = "1 row is" if log.refused.count == 1 else f"{log.refused.count} rows are"
    return (
        f"{path.name}: {rows} at or below the threshold's height and not used, the first in line "
        f"{log.refused.first_line}: on the ground, or is the zero of the heights (alt_m) another?",
    )


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
    above = positions[:, 2] > 0.0
    if above.sum() < 2:
        got = (
            f"a height at or below the threshold's in {'all' if not above.any() else 'all but one'} of {len(rows)} rows"
        )
        raise ImuFileError(str(path), got=got, wanted="two or more rows above it")
    refused = None
    if not above.all():
        refused = RefusedRows(count=int((~above).sum()), first_line=rows[int(np.argmin(above))][0])
    return PoseLog(table[above, 0], positions[above], attitude[above], camera.mount, refused)


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
