"""The reference table of a check: a survey stores it in the rig's folder, each check reads it from there."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from calibration.landmarks.check import Check
from calibration.landmarks.problem import AXES
from calibration.sightings import LandmarkSighting
from groundstation.errors import InputError, os_words
from groundstation.files.overwriting import Output, refuse_overwriting

# a rig turned further than this from what its table saw stands elsewhere by now
_OTHER_SET_UP_RAD = float(np.radians(0.1))
NONE = "none"
# a pixel and two angles that come out the same, row after row, were not seen a second time
_MOST_SAME = 0.5
# the same: as near as tables that were rounded; noise is thirty times as much
_ROUNDED_PX = 0.01
_ROUNDED_RAD = float(np.radians(0.001))
_ROUNDED_S = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonTable:
    """A table to compare with, or None, and a line for the reader; ``kept`` where it was found next to the rig."""

    path: Path | None
    kept: bool
    note: str


def reference_path(rig: Path) -> Path:
    """Return where the sightings of a rig's own survey stand: rig.toml has rig.sightings.csv next to it."""
    return rig.with_suffix(".sightings.csv")


def refuse_keeping_onto(rig: Path, read: Sequence[Path | None]) -> None:
    """Raise `InputError` where the table that is kept next to a rig to write would replace one that is read."""
    refuse_overwriting(read, [Output(path=reference_path(rig))])


def keep_reference(sightings: Path, rig: Path) -> Path:
    """Copy the table that a rig was surveyed with to its place next to it, and return that."""
    kept = reference_path(rig)
    if not (kept.exists() and kept.samefile(sightings)):
        try:
            shutil.copyfile(sightings, kept)
        except OSError as error:
            raise InputError(str(kept), got=os_words(error), wanted="a file that can be written") from error
    return kept


def find_reference(rig: Path, asked: Path | None) -> ComparisonTable:
    """Return the requested table, otherwise the one next to the rig, if it exists; ``none`` for no reference."""
    if asked is not None:
        if str(asked) == NONE:
            return ComparisonTable(path=None, kept=False, note="compared with the rig alone")
        return ComparisonTable(path=asked, kept=False, note=f"compared with {asked.name}")
    kept = reference_path(rig)
    if kept.is_file():
        return ComparisonTable(path=kept, kept=True, note=f"compared with {kept.name}, the survey's own sightings")
    return ComparisonTable(path=None, kept=False, note=f"compared with the rig alone: there is no {kept.name}")


def require_new_sightings(
    today: Sequence[LandmarkSighting], then: Sequence[LandmarkSighting], path: Path, reference: Path
) -> None:
    """Raise `InputError` where today's rows are those of the reference: a table agrees with itself, whatever moved.

    Numbers are compared, not their text: rounded numbers are no new sightings.
    """
    same = _count_same(today, then)
    if same > _MOST_SAME * len(today):
        got = f"{same} of {len(today)} rows that stand in {reference.name}, too"
        wanted = "rows seen today: a table compared with itself shows no knock"
        raise InputError(path.name, got=got, wanted=f"{wanted} (where all comes out the same, t_s tells them apart)")


def _count_same(today: Sequence[LandmarkSighting], then: Sequence[LandmarkSighting]) -> int:
    """Return how many of today's rows are rows of then, as near as rounding leaves them; stamps if all have one."""
    stamped = all(sighting.t_s is not None for sighting in (*today, *then))
    numbers: dict[tuple[str, str], tuple[list[list[float]], list[list[float]]]] = {}
    for table, sightings in enumerate((today, then)):
        for sighting in sightings:
            both = numbers.setdefault((sighting.station, sighting.landmark), ([], []))
            both[table].append(_in_roundings(sighting, stamped))
    same = 0
    for new, old in numbers.values():
        if new and old:
            away, _ = cKDTree(old).query(new, p=np.inf)
            same += int(np.count_nonzero(away <= 1.0))
    return same


def _in_roundings(sighting: LandmarkSighting, stamped: bool) -> list[float]:
    """Return angles, pixel and perhaps the stamp, each in units of what rounding may do to it."""
    angles = [sighting.pan_rad / _ROUNDED_RAD, sighting.tilt_rad / _ROUNDED_RAD]
    stamp = [sighting.t_s / _ROUNDED_S] if stamped and sighting.t_s is not None else []
    return [*angles, *(sighting.pixel_px / _ROUNDED_PX).tolist(), *stamp]


def other_set_up(check: Check) -> str | None:
    """Return the station whose pose in the reference differs from the rig's, in words, or None."""
    problem = check.fit.problem
    for movement in check.movements:
        names = [f"{movement.station}.runway_from_base.{axis}" for axis in AXES]
        if all(name in problem.names for name in names):
            off = float(np.linalg.norm([check.fit.change[problem.names.index(name)] for name in names]))
            if off > _OTHER_SET_UP_RAD:
                return f"{movement.station} stood {np.degrees(off):.2f} deg otherwise when it was written"
    return None
