"""The runway's own corners as a check of stations: `groundstation calibrate check … --runway NAMES`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibration.sightings import STANDING_DEG, Landmark, Sighting, read_landmarks, read_sightings
from groundstation.errors import InputError
from groundstation.onboard.pose.solve import PoseStatus
from groundstation.onboard.pose.station_check import StationCheck, check_station
from groundstation.rig import Rig, Station, load_rig
from groundstation.toml_table import quoted


def check_runway(sightings: Path, landmarks: Path, rig: Path, names: Sequence[str]) -> tuple[str, bool]:
    """Compare each station's pose by the runway's corners with its rig's; returns a report and whether all agree.

    Stations count that saw all of the named landmarks without turning. Raises `InputError` where none did, or where a
    name is no surveyed point.
    """
    marks = read_landmarks(landmarks)
    corners = [_corner(marks, name, landmarks) for name in names]
    if len(set(names)) < 4 or len(set(names)) < len(names):
        raise InputError("--runway", got=", ".join(names) or "nothing", wanted="four or more different names")
    known: Rig = load_rig(rig)
    known.require_known()
    seen = read_sightings(sightings)
    checks = []
    for station in known.stations:
        check = _check(station, [s for s in seen if s.station == station.name and s.landmark in names], corners)
        if check is not None:
            checks.append(check)
    if not checks:
        wanted = f"a station that sees {', '.join(names)} in one look, without turning, and not all on one line"
        raise InputError(sightings.name, got="none such", wanted=wanted)
    lines = ["by the runway's corners, each station's camera:", *(_line(check) for check in checks)]
    return "\n".join(lines), all(check.agrees for check in checks)


def _corner(marks: dict[str, Landmark], name: str, path: Path) -> Landmark:
    mark = marks.get(name)
    if mark is None or mark.kind != "point" or mark.place is None:
        raise InputError(path.name, got=f"no surveyed point {quoted(name)}", wanted="the names of --runway")
    return mark


def _check(station: Station, seen: Sequence[Sighting], marks: Sequence[Landmark]) -> StationCheck | None:
    """Check one station by its first look that shows all corners; means over that look."""
    if not seen:
        return None
    first = seen[0]
    look = [s for s in seen if _near(s, first)]
    by_name = [[s for s in look if s.landmark == mark.name] for mark in marks]
    if not all(by_name):
        return None
    pixels = np.array([np.mean([s.pixel_px for s in stop], axis=0) for stop in by_name])
    sigma = np.array([stop[0].sigma_px / np.sqrt(len(stop)) for stop in by_name])
    angles = np.array([station.ptu_axes.angles(s.pan_rad, s.tilt_rad, s.pan_from, s.tilt_from) for s in look])
    pan, tilt = (float(value) for value in angles.mean(axis=0))
    # readings average, the step that they stand on does not
    angle_sigma = float(np.hypot(station.ptu_sigma_rad / np.sqrt(len(look)), station.ptu_resolution_rad / np.sqrt(12)))
    corners = np.array([mark.place for mark in marks])
    survey = np.array([mark.sigma for mark in marks])
    try:
        return check_station(station, pan, tilt, corners, pixels, sigma, 0.0 if station.fixed else angle_sigma, survey)
    except ValueError:
        return None


def _near(one: Sighting, other: Sighting) -> bool:
    turned = max(abs(one.pan_rad - other.pan_rad), abs(one.tilt_rad - other.tilt_rad))
    return bool(turned <= np.radians(STANDING_DEG))


def _line(check: StationCheck) -> str:
    """Return one station's line."""
    if check.pose is None:
        return f"  {check.station}: no pose sees these corners so"
    off = ", ".join(f"{value:+.3f}" for value in check.difference[:3])
    turn = ", ".join(f"{value:+.3f}" for value in np.degrees(check.difference[3:]))
    sigma = ", ".join(f"{value:.3f}" for value in np.degrees(np.sqrt(np.diag(check.covariance)[3:])))
    verdict = "agrees" if check.agrees else "does not agree"
    if check.pose.status is PoseStatus.RESIDUAL:
        verdict += f" (the corners fit no pose: {check.pose.reprojection_px:.1f} px left)"
    return (
        f"  {check.station}: {verdict}; off by {off} m, turned by {turn} ± {sigma} deg (x, y, z); "
        f"chi-square {check.statistic:.1f}, limit {check.threshold:.1f}"
    )
