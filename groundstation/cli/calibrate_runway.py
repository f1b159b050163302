"""The runway's own corners as a second opinion in a check: `groundstation calibrate check … --runway NAMES`."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from calibration.landmarks.jobs import ComparisonOutcome
from calibration.sightings import STANDING_DEG, Landmark, LandmarkSighting
from groundstation.errors import InputError, UsageError
from groundstation.files.toml_table import quoted
from groundstation.onboard.pose.pose_solver import PoseStatus
from groundstation.onboard.pose.station_check import StationCheck, check_station
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig, Station

LEAST_CORNERS = 4


def ask_runway(
    rig: Rig, seen: Sequence[LandmarkSighting], marks: Mapping[str, Landmark], names: Sequence[str], path: Path
) -> ComparisonOutcome:
    """Compare each station's pose by the runway's corners with its rig's.

    Stations count that saw all of the named landmarks without turning. Raises `InputError` where none did (``path`` is
    that of the sightings), or where a name is no surveyed point.
    """
    corners = [_corner(marks, name) for name in names]
    if len(set(names)) < LEAST_CORNERS or len(set(names)) < len(names):
        raise UsageError("--runway", got=", ".join(names) or "nothing", wanted="four or more different names")
    checks = []
    for station in rig.stations:
        known = rig.station_covariance(station.name)
        check = _check(station, known, [s for s in seen if s.station == station.name and s.landmark in names], corners)
        if check is not None:
            checks.append(check)
    if not checks:
        wanted = f"a station that sees {', '.join(names)} in one look, without turning, and not all on one line"
        raise InputError(path.name, got="none such", wanted=wanted)
    lines = ["by the runway's corners, each station's camera:", *(_line(check) for check in checks)]
    return ComparisonOutcome(text="\n".join(lines), against=tuple(c.station for c in checks if not c.agrees))


def _corner(marks: Mapping[str, Landmark], name: str) -> Landmark:
    mark = marks.get(name)
    if mark is None or mark.kind != "point" or mark.place is None:
        raise InputError("--runway", got=f"no surveyed point {quoted(name)}", wanted="names of the table of landmarks")
    return mark


def _check(
    station: Station, known: ParameterCovariance, seen: Sequence[LandmarkSighting], marks: Sequence[Landmark]
) -> StationCheck | None:
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
        by_angle = 0.0 if station.fixed else angle_sigma
        return check_station(station, known, pan, tilt, corners, pixels, sigma, by_angle, survey)
    except ValueError:
        return None


def _near(one: LandmarkSighting, other: LandmarkSighting) -> bool:
    turned = max(abs(one.pan_rad - other.pan_rad), abs(one.tilt_rad - other.tilt_rad))
    return bool(turned <= np.radians(STANDING_DEG))


def _line(check: StationCheck) -> str:
    """Return one station's line."""
    if check.pose is None:
        return f"  {check.station}: no pose fits these corners"
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
