"""The tables of a finished replay, read back for a comparison: track.csv, and the references truth.tum and dgps.tum."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.evaluation.position_series import FALLBACK_SIGMA_M
from groundstation.evaluation.run_series import ReferencePositions, RunSeries, TrackSeries, invertible
from groundstation.files.csv_table import MAX_LINE_CHARACTERS, MAX_MAGNITUDE, CsvTable
from groundstation.files.toml_table import quoted
from groundstation.messages import TrackStatus
from groundstation.sinks.track_files import TRACK_COLUMNS

# by the reference's name its trajectory at the pairs' stamps
REFERENCES = {"truth": "truth.tum", "dgps": "dgps.tum"}
# an hour at 30 pairs/s has 108 000; as of a session's references
_MAX_ROWS = 2_000_000
_POSE_CELLS = 8
_STATUSES = frozenset(status.value for status in TrackStatus)
_POSITION = slice(1, 4)
_COVARIANCE = slice(7, 13)


def read_run(folder: Path, name: str, summary: Mapping[str, Any]) -> RunSeries:
    """Return a run's track, and its references as far as their files exist; raises `InputError` for a bad table."""
    track = read_track(folder / "track.csv")
    references = {}
    for reference, file in REFERENCES.items():
        path = folder / file
        if path.is_file():
            position_m = _at_rows(track.t_s, _read_tum(path))
            references[reference] = ReferencePositions(position_m=position_m, sigma_m=_sigma_m(reference, summary))
    return RunSeries(name=name, track=track, references=references)


def read_track(path: Path) -> TrackSeries:
    """Read a track.csv; raises `SessionError` if it is missing, or at its first faulty row."""
    table = CsvTable(path, TRACK_COLUMNS)
    rows: list[list[float]] = []
    statuses: list[str] = []
    before: float | None = None
    for row in table:
        before = table.advance(row, "t_s", before)
        values = [table.optional_number(row, column) for column in TRACK_COLUMNS[1:-1]]
        rows.append([before, *(math.nan if value is None else value for value in values)])
        status = row.text["status"]
        if status not in _STATUSES:
            wanted = ", ".join(s.value for s in TrackStatus)
            raise table.fault(row.line, got=f"status {quoted(status)}", wanted=wanted)
        statuses.append(status)
        if len(rows) > _MAX_ROWS:
            raise table.fault(row.line, got="more rows", wanted=f"at most {_MAX_ROWS}")
    numbers = np.array(rows, dtype=np.float64).reshape(-1, len(TRACK_COLUMNS) - 1)
    covariance = np.zeros((len(numbers), 3, 3))
    upper = np.triu_indices(3)
    covariance[:, upper[0], upper[1]] = covariance[:, upper[1], upper[0]] = numbers[:, _COVARIANCE]
    return TrackSeries(
        t_s=numbers[:, 0],
        status=np.array(statuses, dtype=np.str_),
        position_m=numbers[:, _POSITION],
        covariance_m2=invertible(covariance),
    )


def _read_tum(path: Path) -> FloatArray:
    """Read the times and positions (m, 4) of a TUM trajectory; raises `InputError` at its first faulty line."""
    rows: list[list[float]] = []
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            for number, line in enumerate(_lines(file.readline), start=1):
                if line.strip() and not line.startswith("#"):
                    rows.append(_pose(line, f"{path.name}: line {number}"))
                if len(rows) > _MAX_ROWS:
                    raise InputError(f"{path.name}: line {number}", got="more rows", wanted=f"at most {_MAX_ROWS}")
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted="a file that can be read") from fault
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _lines(readline: Any) -> Iterator[str]:
    """Yield lines; one that is longer than any row arrives in parts, which are no rows."""
    while line := readline(MAX_LINE_CHARACTERS):
        yield line


def _pose(line: str, where: str) -> list[float]:
    """Return t, x, y, z of a line; raises `InputError` for anything but eight finite numbers."""
    cells = line.split()
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        values = []
    if len(values) != _POSE_CELLS or not all(abs(value) <= MAX_MAGNITUDE for value in values):
        raise InputError(where, got=quoted(line.strip()), wanted="t x y z qx qy qz qw, eight finite numbers")
    return values[:4]


def _at_rows(t_s: FloatArray, poses: FloatArray) -> FloatArray:
    """Return the reference (n, 3) at the track's times (n,), which both files state to the microsecond."""
    found = np.full((len(t_s), 3), np.nan)
    _, rows, matching = np.intersect1d(
        np.rint(1e6 * t_s), np.rint(1e6 * poses[:, 0]), assume_unique=False, return_indices=True
    )
    found[rows] = poses[matching, 1:]
    return found


def _sigma_m(reference: str, summary: Mapping[str, Any]) -> FloatArray:
    """Return a reference's own noise (3,): of the truth none, of DGPS as the replay has found it."""
    if reference == "truth":
        return np.zeros(3)
    stated = summary["reference"].get("noise_sigma_m") if isinstance(summary["reference"], Mapping) else None
    if not isinstance(stated, list) or len(stated) != 3:
        return np.full(3, FALLBACK_SIGMA_M)
    usable = [isinstance(v, int | float) and not isinstance(v, bool) and 0.0 <= v <= MAX_MAGNITUDE for v in stated]
    return np.array([v if ok else FALLBACK_SIGMA_M for v, ok in zip(stated, usable, strict=True)], dtype=np.float64)
