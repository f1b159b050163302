"""The ground station's track as positions over the near threshold: of a replay's track.csv, or any TUM trajectory."""

from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.files.csv_table import CsvTable
from groundstation.files.text_file import absence
from groundstation.files.toml_table import finite_number, shown
from groundstation.onboard.pose.agreement import PositionTrack

_PLACE = ("x_m", "y_m", "z_m")
_COVARIANCE = ("cov_xx_m2", "cov_xy_m2", "cov_xz_m2", "cov_yy_m2", "cov_yz_m2", "cov_zz_m2")
_MOST_TUM_NUMBERS = 8


class GroundTrackError(InputError):
    """A ground track is not usable."""


def read_ground_track(path: Path, threshold_m: FloatArray, sigma_m: float) -> PositionTrack:
    """Read a track; raises `InputError`.

    Parameters
    ----------
    path : track.csv of a replay, or a TUM trajectory (``.tum``, ``.txt``), which has no covariance.
    threshold_m : (3,) the near threshold's middle in the track's frame, whose axes are parallel to the runway's.
    sigma_m : of each coordinate where the file has no covariance.
    """
    if not path.is_file():
        raise GroundTrackError(str(path), got=absence(path), wanted="track.csv of a replay, or a TUM trajectory")
    t, places, covariances = _from_csv(path, sigma_m) if path.suffix == ".csv" else _from_tum(path, sigma_m)
    if len(t) < 2:
        raise GroundTrackError(str(path), got=f"{len(t)} positions", wanted="a track of two or more")
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if len(back):
        before, now = t[back[0] : back[0] + 2]
        raise GroundTrackError(f"{path}: time", got=f"{now:.15g} after {before:.15g} s", wanted="growing times")
    return PositionTrack(t_s=t, position_m=places - threshold_m, covariance_m2=covariances)


def _from_csv(path: Path, sigma_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    table = CsvTable(path, ["t_s", *_PLACE])
    stated = set(_COVARIANCE) <= set(table.columns)
    times, places, covariances = [], [], []
    for row in table:
        place = [table.optional_number(row, name) for name in _PLACE]
        if None in place:
            continue
        times.append(table.number(row, "t_s"))
        places.append(place)
        if stated:
            xx, xy, xz, yy, yz, zz = (table.number(row, name) for name in _COVARIANCE)
            covariance = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            covariance = sigma_m**2 * np.eye(3)
        if np.linalg.eigvalsh(covariance)[0] <= 0.0:
            raise table.fault(row.line, got="a covariance that is none", wanted="a positive definite one")
        covariances.append(covariance)
    return np.array(times), np.array(places, dtype=np.float64), np.array(covariances)


def _from_tum(path: Path, sigma_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    rows = []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as fault:
        raise GroundTrackError(str(path), got=shown(os_words(fault)), wanted="a TUM trajectory") from fault
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        values = [finite_number(_number(word)) for word in words]
        if len(values) != _MOST_TUM_NUMBERS or None in values:
            wanted = "t x y z qx qy qz qw"
            raise GroundTrackError(f"{path.name}: line {number}", got=repr(shown(line)), wanted=wanted)
        rows.append(values[:4])
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    covariances = np.broadcast_to(sigma_m**2 * np.eye(3), (len(table), 3, 3))
    return table[:, 0], table[:, 1:], np.asarray(covariances)


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None
