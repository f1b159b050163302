"""The table that a check compares with: kept beside the rig by a survey, found there by each check."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.check import Check
from calibration.landmark_problem import AXES
from calibration.sightings import Sighting
from groundstation.errors import InputError

# a rig turned further than this from what its table saw stands elsewhere by now
_OTHER_SET_UP_RAD = float(np.radians(0.1))
NONE = "none"
# a pixel and two angles that come out the same to the last digit, row after row, were not seen a second time
_MOST_SAME = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """A table to compare with, or None, and a line for the reader; ``kept`` where it was found beside the rig."""

    path: Path | None
    kept: bool
    note: str


def reference_path(rig: Path) -> Path:
    """Return where the sightings of a rig's own survey stand: rig.toml has rig.sightings.csv beside it."""
    return rig.with_suffix(".sightings.csv")


def keep_reference(sightings: Path, rig: Path) -> Path:
    """Copy the table that a rig was surveyed with to its place beside it, and return that."""
    kept = reference_path(rig)
    if not (kept.exists() and kept.samefile(sightings)):
        try:
            shutil.copyfile(sightings, kept)
        except OSError as error:
            raise InputError(str(kept), got=str(error.strerror), wanted="a file that can be written") from error
    return kept


def find_reference(rig: Path, asked: Path | None) -> Reference:
    """Return the table asked for, else the one beside the rig, if there is one; ``none`` asks for none."""
    if asked is not None:
        if str(asked) == NONE:
            return Reference(path=None, kept=False, note="compared with the rig alone")
        return Reference(path=asked, kept=False, note=f"compared with {asked.name}")
    kept = reference_path(rig)
    if kept.is_file():
        return Reference(path=kept, kept=True, note=f"compared with {kept.name}, the survey's own sightings")
    return Reference(path=None, kept=False, note=f"compared with the rig alone: there is no {kept.name}")


def require_seen_anew(today: Sequence[Sighting], then: Sequence[Sighting], path: Path, reference: Path) -> None:
    """Raise `InputError` where today's rows are those of the reference: a table agrees with itself, whatever moved."""
    known = {_row(sighting) for sighting in then}
    same = sum(_row(sighting) in known for sighting in today)
    if same > _MOST_SAME * len(today):
        got = f"{same} of {len(today)} rows that stand in {reference.name}, too"
        wanted = "rows seen today: a table compared with itself shows no knock"
        raise InputError(path.name, got=got, wanted=f"{wanted} (where all comes out the same, t_s tells them apart)")


def _row(sighting: Sighting) -> tuple[object, ...]:
    angles = (sighting.pan_rad, sighting.tilt_rad)
    return (sighting.station, sighting.landmark, *angles, *sighting.pixel_px.tolist(), sighting.t_s)


def other_set_up(check: Check) -> str | None:
    """Return which station the reference saw standing otherwise than the rig says, in words, or None."""
    problem = check.fit.problem
    for movement in check.movements:
        names = [f"{movement.station}.runway_from_base.{axis}" for axis in AXES]
        if all(name in problem.names for name in names):
            off = float(np.linalg.norm([check.fit.change[problem.names.index(name)] for name in names]))
            if off > _OTHER_SET_UP_RAD:
                return f"{movement.station} stood {np.degrees(off):.2f} deg otherwise when it was written"
    return None
