"""The result of a calibration by stars, in words: each head, what heads have in common, what the night left open."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from calibration.lens.advice import along_m
from calibration.mount.covariance import BASE, BORESIGHT
from calibration.mount.problem import AXES, PERIODIC_AXES
from calibration.stars.calibrate import NightCalibration
from calibration.stars.joint_night import common_sigma, relative_sigma
from calibration.stars.plausibility import off_level_deg
from calibration.stars.sky import utc_text
from calibration.stars.station_night import StationNight, undetermined
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.rig.ptu_axes import axes_in_file_units

RANGES_M = (100.0, 200.0, 400.0)
GOOD_RELATIVE_DEG = 0.002
BEST_RELATIVE_DEG = 0.001
_MOST_UNUSED = 12
_MISFIT = 1.5
# how many degrees of which axis a parameter wants, 0 pan and 1 tilt
_SPAN_DEG = {
    "head_from_camera": (1, 30.0),
    "runway_from_base": (0, 60.0),
    "pan_scale": (0, 60.0),
    "tilt_scale": (1, 30.0),
    "tilt_sag": (1, 45.0),
    "lean": (1, 30.0),
    "pan_sine": (0, 120.0),
    "pan_cosine": (0, 120.0),
}
_NEEDED = {
    "pan_backlash": "each axis come to from both sides (columns pan_from, tilt_from)",
    "tilt_backlash": "each axis come to from both sides (columns pan_from, tilt_from)",
    "distortion": "more stars near the picture's corners, or a camera with a wider field",
}


def format_night(found: NightCalibration) -> str:
    """Return the whole report."""
    parts = [_station(found, k) for k in range(len(found.joint.nights))]
    first, last = (utc_text(t) for t in found.span_utc_s)
    head = f"{first} to {last}, latitude {found.site.lat_deg:.4f}, longitude {found.site.lon_deg:.4f}"
    lines = ["verdict:", *("  " + line for line in verdict(found))]
    return "\n\n".join([head, *parts, "\n".join(lines)])


def _station(found: NightCalibration, k: int) -> str:
    night = found.joint.nights[k]
    fit = night.fit
    seen = fit.problem.sightings
    span = np.degrees([np.ptp(seen.reading_rad[:, axis]) for axis in (0, 1)])
    pictures = len(night.pictures)
    lines = [
        f"station {night.before.name}: {pictures} of {pictures + len(night.unused)} pictures used over"
        f" {span[0]:.0f} deg of pan and {span[1]:.0f} deg of tilt, {int(fit.kept.sum())} stars,"
        f" {int((~fit.kept).sum())} left out",
        "",
        f"{'parameter':<22}{'value':>12}{'sigma':>12}{'change':>12}  unit",
        *(_row(found, k, name) for name in (*BORESIGHT, *BASE, *AXES, *PERIODIC_AXES) if name in fit.problem.names),
        *(_row(found, k, name) for name in fit.problem.names if name.startswith(("focal", "principal", "distortion"))),
        "",
        _residuals(found, k),
        *(f"not used: {text}" for text in night.unused[:_MOST_UNUSED]),
    ]
    if len(night.unused) > _MOST_UNUSED:
        lines.append(f"not used: {len(night.unused) - _MOST_UNUSED} more")
    return "\n".join(lines)


def _row(found: NightCalibration, k: int, name: str) -> str:
    """Return one parameter's row; a rotation has no value of its own but the change since the rig."""
    night, station = found.joint.nights[k], found.stations[k]
    place = night.fit.problem.names.index(name)
    change = float(found.joint.change[k][place])
    sigma = float(np.sqrt(found.joint.of(k)[place, place]))
    group, _, part = name.partition(".")
    unit, scale, value = "deg", float(np.degrees(1.0)), ""
    if group in ("focal", "principal_point"):
        unit, scale = "px", 1.0
        value = f"{getattr(station.lens, f'{group}_px')['xy'.index(part)]:.2f}"
    elif group == "distortion":
        unit, scale = "1", 1.0
        value = f"{station.lens.distortion[('k1', 'k2', 'p1', 'p2', 'k3').index(part)]:.5f}"
    elif name in (*AXES, *PERIODIC_AXES):
        key = f"{name}_ppm" if name.endswith("scale") else f"{name}_deg"
        unit, scale = ("ppm", 1e6) if name.endswith("scale") else (unit, scale)
        value = f"{axes_in_file_units(station.ptu_axes)[key]:.5g}"
    else:
        # the fit starts from the pictures, not from the rig
        turned = (
            matrix_from_wxyz(getattr(station, f"{group}_wxyz"))
            @ matrix_from_wxyz(getattr(night.before, f"{group}_wxyz")).T
        )
        change = float(Rotation.from_matrix(turned).as_rotvec()["xyz".index(part)])
    return f"{name:<22}{value:>12}{scale * sigma:>12.5f}{scale * change:>+12.5f}  {unit}"


def _residuals(found: NightCalibration, k: int) -> str:
    fit = found.joint.nights[k].fit
    seen = fit.problem.sightings
    own = [
        fit.residual_px[rows] - fit.residual_px[rows].mean(axis=0)
        for n in np.unique(seen.pointing)
        if np.count_nonzero(rows := fit.kept & (seen.pointing == n)) > 1
    ]
    within = float(np.sqrt(np.mean(np.concatenate(own) ** 2))) if own else float("nan")
    arcsec = 3600.0 * np.degrees(within / float(fit.problem.station.lens.focal_px.mean()))
    text = (
        f"residuals: {fit.rms_px:.2f} px rms per axis, within a picture {within:.2f} px ({arcsec:.1f} arcsec);"
        f" {fit.noise_factor:.2f} times the noise of stars and readings"
    )
    if fit.noise_factor > _MISFIT:
        text += "; the sigmas are raised by that: does the head hold still, is ptu_sigma_deg right?"
    return text


def verdict(found: NightCalibration) -> list[str]:
    """Return the verdict's lines: relative and common direction, what it is along the runway, what to do next."""
    joint = found.joint
    names = [night.before.name for night in joint.nights]
    lines = []
    if len(names) > 1:
        for k in range(1, len(names)):
            lines += _pair(found, 0, k)
    else:
        lines.append(f"one head alone: its range hangs on another, {names[0]} says nothing of it")
    common = common_sigma(joint)
    lines.append(
        f"direction from true north, all heads together: {common.pan_deg:.4f} deg in pan, {common.tilt_deg:.4f} deg in"
        " tilt (1 sigma: clock, refraction, encoders; the azimuth of the runway's y axis is taken as exact)"
    )
    open_in: dict[str, list[str]] = {}
    for night in joint.nights:
        for name in undetermined(night):
            open_in.setdefault(name, []).append(night.before.name)
    level = ", ".join(f"{s.name} {off_level_deg(s):.1f} deg" for s in found.stations)
    lines.append(f"bases off level: {level} (more than a level's error says that time or place are wrong)")
    for night in joint.nights:
        if night.reading_factor > 1.0:
            said = float(np.degrees(night.before.angle_sigma_rad))
            seen = night.reading_factor * said
            lines.append(
                f"{night.before.name}: readings repeat to {seen:.4f} deg, the rig says {said:.4f}"
                " (ptu_sigma_deg, ptu_resolution_deg); the sigmas are those of what was seen"
            )
    for name, stations in open_in.items():
        needed = needed_for(name, [n for n in joint.nights if n.before.name in stations])
        lines.append(f"{name} ({', '.join(stations)}) is hardly better known than before; needed: {needed}")
    if found.without:
        lines.append("without pictures, unchanged: " + ", ".join(found.without))
    lines.append(
        "positions and lever arms are the rig's: stars do not see them; 1 cm of the baseline is 0.05 deg of the"
        " direction that both heads share (`groundstation calibrate survey`)"
    )
    return lines


def needed_for(name: str, nights: Sequence[StationNight]) -> str:
    """Return what would tell a parameter of some heads better: a wider range only where theirs is too narrow."""
    group = name.partition(".")[0]
    if group not in _SPAN_DEG:
        return _NEEDED.get(group, "other pictures")
    axis, least = _SPAN_DEG[group]
    word = ("pan", "tilt")[axis]
    spans = [float(np.degrees(np.ptp(n.fit.problem.sightings.reading_rad[:, axis]))) for n in nights]
    if min(spans) < least:
        return f"pictures over {least:.0f} deg or more of {word}"
    return f"more pictures, or readings that repeat better (their {min(spans):.0f} deg of {word} suffice)"


def _pair(found: NightCalibration, first: int, second: int) -> list[str]:
    """Return what is known of two heads' relative direction, and what more pictures would tell."""
    lines = relative_lines(found, first, second)
    nights, sigma = found.joint.nights, relative_sigma(found.joint, first, second)
    pictures = min(len(nights[k].pictures) for k in (first, second))
    if sigma.pan_deg > BEST_RELATIVE_DEG:
        needed = int(np.ceil(pictures * (sigma.pan_deg / BEST_RELATIVE_DEG) ** 2))
        lines.append(f"{BEST_RELATIVE_DEG} deg takes some {needed} pictures of each head spread like these")
    return lines


def relative_lines(found: NightCalibration, first: int, second: int) -> list[str]:
    """Return what is known of two heads' relative direction, and what that is along the line of sight."""
    nights = found.joint.nights
    sigma = relative_sigma(found.joint, first, second)
    word = "good" if sigma.pan_deg <= GOOD_RELATIVE_DEG else "usable" if sigma.pan_deg <= 0.01 else "not good enough"
    stations = [found.rig[nights[k].before.name] for k in (first, second)]
    baseline = float(np.linalg.norm(stations[0].ptu_position_m - stations[1].ptu_position_m))
    lines = [
        f"{word}: {nights[first].before.name} against {nights[second].before.name} is known to {sigma.pan_deg:.4f} deg"
        f" in pan, {sigma.tilt_deg:.4f} deg in tilt (1 sigma, pan -30 to 30, tilt 0 to 15 deg)"
    ]
    if baseline > 0.0:
        # both heads' share of the relative angle is in it already
        along = [f"{along_m(sigma.pan_deg / np.sqrt(2.0), r, baseline):.2f} m at {r:.0f} m" for r in RANGES_M]
        lines.append("that is along the line of sight: " + ", ".join(along))
    return lines
