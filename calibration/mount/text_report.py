"""The result of a mount's calibration, in words: parameters, residuals, quality, next steps."""

import numpy as np

from calibration.lens.advice import across_m, along_m
from calibration.mount.calibrate import StationMount
from calibration.mount.covariance import BASE, BORESIGHT
from calibration.mount.fit import MountFit
from calibration.mount.parameters import LEVER
from calibration.mount.pointing import USABLE_DEG, PointingSigma, pointing_sigma
from calibration.mount.problem import AXES
from calibration.reading_scale import scale_doubt
from groundstation.rig.ptu_axes import axes_in_file_units

RANGES_M = (100.0, 200.0, 400.0)
GOOD_BORESIGHT_DEG = 0.003
GOOD_DEG = 0.003
_MOST_REJECTED = 20
_MISFIT = 1.3
_NEEDED = {
    "head_from_camera": "marks of known place or direction, some of them 20 deg or more above the others",
    "runway_from_base": "marks of known place or direction, 60 deg or more apart in pan",
    "camera_in_head": "a mark or board a few metres away, seen over 20 deg or more of pan and tilt; else a ruler does",
    "lean": "known marks at tilts 40 deg or more apart",
    "pan_scale": "known marks 60 deg or more apart in pan",
    "tilt_scale": "known marks 40 deg or more apart in tilt",
    "pan_backlash": "each place approached once from the left and once from the right (pan_from)",
    "tilt_backlash": "each place approached once from below and once from above (tilt_from)",
    "pan_zero": "known marks; without them it is the base's heading",
    "tilt_zero": "known marks",
}


def format_mount(one: StationMount) -> str:
    """Return one station's report."""
    fit, seen = one.fit, one.fit.problem.sightings
    marks = len(fit.problem.marks)
    lines = [
        f"station {one.before.name}: {len(seen)} sightings of {marks} mark{'s' * (marks != 1)},"
        f" {len(np.unique(fit.problem.stand))} standstills, {int(fit.kept.sum())} used",
        "",
        f"{'parameter':<22}{'value':>12}{'sigma':>12}{'change':>12}  unit",
        *(_row(one, name) for name in (*BORESIGHT, *LEVER, *BASE, *AXES)),
        "",
        *_residuals(fit),
        *(f"left out: {r.label}: {r.reason}" for r in fit.rejected[:_MOST_REJECTED]),
    ]
    if len(fit.rejected) > _MOST_REJECTED:
        lines.append(f"left out: {len(fit.rejected) - _MOST_REJECTED} more")
    return "\n".join([*(line for line in lines if line is not None), "", "verdict:", *_indented(verdict(one))])


def _indented(lines: list[str]) -> list[str]:
    return ["  " + line for line in lines]


def _row(one: StationMount, name: str) -> str:
    """Return one parameter's row; a rotation has no value of its own but the change since the rig."""
    fit = one.fit
    group, _, axis = name.partition(".")
    unit, scale, value = "deg", float(np.degrees(1.0)), ""
    if group == "camera_in_head":
        unit, scale, value = "m", 1.0, f"{one.after.camera_in_head_m['xyz'.index(axis)]:.4f}"
    elif name in AXES:
        key = f"{name}_ppm" if name.endswith("scale") else f"{name}_deg"
        unit, scale = ("ppm", 1e6) if name.endswith("scale") else (unit, scale)
        value = f"{axes_in_file_units(one.after.ptu_axes)[key]:.5g}"
    if name in fit.problem.names:
        change = scale * fit.change[fit.problem.names.index(name)]
        return f"{name:<22}{value:>12}{scale * fit.sigma(name):>12.5f}{change:>+12.5f}  {unit}"
    why = "held: not determined" if name in fit.held else "held"
    return f"{name:<22}{value:>12}{why:>24}  {unit}"


def _residuals(fit: MountFit) -> list[str]:
    seen = fit.problem.sightings
    sought = fit.problem.predict(fit.change)
    noise = fit.problem.covariance_px2(sought.by_angle)[fit.kept]
    alone = float(np.sqrt(np.mean(np.einsum("nii->n", noise)) / 2.0))
    lines = [
        f"residuals: {fit.rms_px:.2f} px rms per axis; noise of pixels"
        f" ({float(np.sqrt(np.mean(seen.sigma_px**2))):.2f} px) and readings"
        f" ({np.degrees(fit.problem.station.angle_sigma_rad):.4f} deg) alone gives {alone:.2f} px"
    ]
    held_out = fit.held_out
    if held_out is None:
        return [*lines, "held-out angles: too few pairs of angles to keep some apart"]
    return [
        *lines,
        f"held-out angles, a fifth: {held_out.rms_px:.2f} px rms; noise alone gives {held_out.noise_px:.2f},"
        f" with what the rest leaves uncertain {held_out.expected_px:.2f} px",
    ]


def verdict(one: StationMount) -> list[str]:
    """Return the verdict's lines: uncertainty by range, undetermined parameters, next steps."""
    fit = one.fit
    at = pointing_sigma(fit)
    word = "good" if at.worst_deg <= GOOD_DEG else "usable" if at.worst_deg <= USABLE_DEG else "not good enough"
    tied = any(mark.kind.known for mark in fit.problem.marks)
    lines = [
        f"{word}: the camera's orientation is known to {at.pan_deg:.4f} deg in pan, {at.tilt_deg:.4f} deg in tilt,"
        f" {at.roll_deg:.4f} deg in roll (1 sigma, {'from the runway' if tied else 'from its base'},"
        " pan -30 to 30, tilt 0 to 15 deg)"
    ]
    axes = fit.problem.axes(fit.change)
    for name, scale in (("pan", axes.pan_scale), ("tilt", axes.tilt_scale)):
        doubt = scale_doubt(scale)
        lines += [f"doubtful: in {name} {doubt}"] if doubt else []
    parts = []
    for away in RANGES_M:
        parts.append(f"{across_m(at.worst_deg, away):.3f} / {along_m(at.pan_deg, away):.2f} m at {away:.0f} m")
    lines.append("that is across / along the runway, two such stations 10 m apart: " + "; ".join(parts))
    for name in fit.held:
        needed = _NEEDED.get(name.partition(".")[0], "other sightings")
        lines.append(f"{name} is not determined by these sightings and stays as it was; needed: {needed}")
    lines += _gauges(fit, tied)
    lines += _boresight(fit) if tied else []
    lines += _next(one, at)
    return lines


def _boresight(fit: MountFit) -> list[str]:
    """Return the uncertainty of the boresight itself, apart from base and axes, and a way to improve it."""
    free = [name for name in BORESIGHT if name in fit.problem.names]
    if len(free) < len(BORESIGHT):
        return []
    sigma = np.degrees([fit.sigma(name) for name in free])
    text = f"boresight by itself: {sigma[0]:.4f} / {sigma[1]:.4f} / {sigma[2]:.4f} deg about the head's x / y / z"
    if sigma.max() <= GOOD_BORESIGHT_DEG:
        return [text]
    times = (sigma.max() / GOOD_BORESIGHT_DEG) ** 2
    return [
        f"{text}; {GOOD_BORESIGHT_DEG} deg (for this camera on another base) takes {times:.0f} times as many such"
        " sightings, far fewer with marks near the picture's corners (y) and at tilts of 50 to 75 deg (z)"
    ]


def _gauges(fit: MountFit, tied: bool) -> list[str]:
    if not tied:
        return [
            "no mark of known place: the base's attitude is not touched; it is for `calibrate survey`"
            " (a pan zero is the same as its heading)"
        ]
    if "pan_zero" in fit.problem.names:
        return ["zeros were sought in place of the base's heading and the boresight's tilt, which turn the same way"]
    return [
        "pan_zero is in the base's heading and tilt_zero in head_from_camera.x: sightings cannot tell them apart"
        " (--free zero,… puts them into the zeros)"
    ]


def _next(one: StationMount, at: PointingSigma) -> list[str]:
    fit = one.fit
    lines = []
    gone = len(fit.rejected) / len(fit.kept)
    if gone > 0.05:
        lines.append(f"next: look at what was left out ({100.0 * gone:.0f} % of the sightings)")
    if fit.noise_factor > _MISFIT:
        lines.append(
            f"next: sightings scatter {fit.noise_factor:.1f} times as far as their noise: does the mount slip, do marks"
            " move, are sigma_px and ptu_sigma_deg right? All sigmas are raised by that"
        )
    if at.worst_deg > GOOD_DEG and not fit.held:
        times = (at.worst_deg / GOOD_DEG) ** 2
        lines.append(f"next: about {times:.0f} times as many sightings for {GOOD_DEG} deg, or higher and farther marks")
    elif at.worst_deg > GOOD_DEG:
        lines.append("next: the sightings named above, then again")
    return lines or ["next: `groundstation calibrate survey`, or fly"]
