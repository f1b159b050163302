"""The record of checks: one line of JSON for each, in the rig's folder, also for those that ended in an error."""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibration.landmarks.check import FALSE_ALARM, Check, StationMovement
from calibration.sightings import LandmarkSighting
from groundstation.errors import InputError, os_words
from groundstation.files.whole_file import write_whole

RECORD_FORMAT = "groundstation-check/1"
_AXES = (("pan", 2), ("tilt", 0), ("roll", 1))


def record_path(rig: Path) -> Path:
    """Return the default path of a rig's record: rig.checks.jsonl in the folder of rig.toml."""
    return rig.with_suffix(".checks.jsonl")


def check_record(
    files: dict[str, Path], sightings: Sequence[LandmarkSighting], check: Check | None, decision: str, reason: str = ""
) -> dict[str, Any]:
    """Return one check for JSON.

    Parameters
    ----------
    files : the files read, by role; each is named with the beginning of its SHA-256, to identify it later.
    check : None where the check ended in an error, given in ``reason``.
    """
    times = [s.t_s for s in sightings if s.t_s is not None]
    record: dict[str, Any] = {
        "format": RECORD_FORMAT,
        "files": {role: {"name": path.name, "sha256": _digest(path)} for role, path in files.items()},
        "from_s": min(times, default=None),
        "to_s": max(times, default=None),
        "seen": _counts(sightings),
        "decision": decision,
        "reason": reason,
        "false_alarm": FALSE_ALARM,
        "stations": {},
    }
    if check is not None:
        record["stations"] = {m.station: _station(check, m) for m in check.movements}
        record["not_checked"] = list(check.unseen)
        record["left_out"] = {
            "landmarks": list(check.fit.rejected_landmarks),
            "sightings": int((~check.fit.kept).sum()),
        }
    return record


def append_record(path: Path, record: dict[str, Any]) -> None:
    """Append a record as one line; raises `InputError` where the file cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        before = path.read_bytes() if path.is_file() else b""
        line = json.dumps(record, ensure_ascii=False, allow_nan=False) + "\n"
        write_whole(path, before + line.encode())
    except OSError as error:
        raise InputError(str(path), got=os_words(error), wanted="a file that can be written") from error


def _counts(sightings: Sequence[LandmarkSighting]) -> dict[str, dict[str, int]]:
    counts: dict[str, dict[str, int]] = {}
    for s in sightings:
        own = counts.setdefault(s.station, {})
        own[s.landmark] = own.get(s.landmark, 0) + 1
    return counts


def _station(check: Check, movement: StationMovement) -> dict[str, Any]:
    degrees = {
        what: {axis: round(float(np.degrees(values[k])), 6) for axis, k in _AXES}
        for what, values in (
            ("turned_deg", movement.turned_rad),
            ("sigma_deg", movement.sigma_rad),
            ("would_have_found_deg", movement.detectable_rad),
        )
    }
    return {
        "moved": movement.moved,
        "part": movement.group,
        **degrees,
        "chi_square": round(movement.statistic, 3),
        "alarm_above": round(movement.threshold, 3),
        "along_at_400_m": check.along_m[movement.station],
        "landmarks": list(movement.landmarks),
    }


def _digest(path: Path) -> str | None:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    except OSError:
        return None
