"""Pairing of the frames of free-running cameras: nearest in time, each frame used once."""

import csv
import io
from collections.abc import Iterator, Mapping

import numpy as np

from groundstation.arrays import FloatArray

# of the shorter frame interval: farther apart, a frame is nearer to the other camera's next one
_SHARE = 0.5
# where no camera gave two frames: their interval, as of cameras of 10 Hz
_UNKNOWN_S = 0.1


def frames_csv(stamps_s: Mapping[str, FloatArray]) -> str:
    """Return frames.csv for stations' stamps (n,) in s: each frame in one row, with its number in its own video."""
    names = list(stamps_s)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["index", *(f"{n}_t_s" for n in names), *(f"{n}_index" for n in names)])
    place = dict.fromkeys(names, 0)
    for row, taken in enumerate(frames_rows(stamps_s)):
        times = [f"{taken[n]:.6f}" if n in taken else "" for n in names]
        writer.writerow([row, *times, *(place[n] if n in taken else "" for n in names)])
        for n in taken:
            place[n] += 1
    return out.getvalue()


def frames_rows(stamps_s: Mapping[str, FloatArray]) -> Iterator[dict[str, float]]:
    """Yield the frames that belong together, by station their stamps, in order of time; each frame comes once."""
    # a camera that gave one frame has no interval
    intervals = (float(np.median(np.diff(t))) for t in stamps_s.values() if len(t) > 1)
    tolerance = _SHARE * min(intervals, default=_UNKNOWN_S)
    place = dict.fromkeys(stamps_s, 0)
    while waiting := {n: float(t[place[n]]) for n, t in stamps_s.items() if place[n] < len(t)}:
        first = min(waiting.values())
        taken = {n: t for n, t in waiting.items() if t - first <= tolerance}
        for n in taken:
            place[n] += 1
        yield taken


def paired(stamps_s: Mapping[str, FloatArray]) -> int:
    """Return how many rows of `frames_csv` hold frames of two stations or more."""
    return sum(len(taken) > 1 for taken in frames_rows(stamps_s))
