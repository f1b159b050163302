"""What a flight has taught, in words: a table of parameters, how well pixels fit, and what it is good for."""

from collections.abc import Sequence

import numpy as np

from calibration.flight import FlightFit
from calibration.flight_problem import FlightProblem
from calibration.flight_rig import FLOOR_CLOCK_S, FLOOR_POSITION_M, FLOOR_ROTATION_RAD
from groundstation.arrays import FloatArray
from groundstation.geometry.aim import aim_at
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS, project_with_calibration
from groundstation.rig import ClockModel, Rig

_BAD_CORRELATION = 0.95
# a sigma that is hardly below what was known before has been taught nothing
_TAUGHT = 0.7
_MOST_PAIRS = 6
_MOST_SPANS = 12
_SHARES = (0.05, 0.35, 0.65, 0.95)
_MOST_CONDITION = 1e10


def format_flight_report(
    before: Rig, after: Rig, fit: FlightFit, excluded: Sequence[str], antenna_m: FloatArray | None
) -> str:
    """Return the whole report: parameters, residuals, exclusions, verdict."""
    lines = [f"{'parameter':<34}{'value':>14}{'sigma':>12}{'change':>14}  unit"]
    for k, name in enumerate(fit.problem.names):
        lines.append(_row(before, after, fit, k, name, antenna_m))
    lines.append("")
    for name, station in fit.stations.items():
        usable, kept, looks = int(station.usable.sum()), int(station.kept.sum()), len(station.usable)
        lines.append(
            f"{name}: {station.rms_px:.2f} px rms over {kept} pixels; {usable - kept} gross, "
            f"{looks - usable} without angle or DGPS{_gross_times(fit, name)}"
        )
    lines += [f"left out: {text}" for text in excluded[:_MOST_SPANS]]
    if len(excluded) > _MOST_SPANS:
        lines.append(f"left out: {len(excluded) - _MOST_SPANS} more stretches of DGPS")
    return "\n".join([*lines, "", *_verdict(after, fit)])


def rig_header(session: str, fit: FlightFit) -> str:
    """Return the comment at the head of the rig file: where it comes from and why sigmas are what they are."""
    worst = max(float(fit.lasting_factor.max()), 1.0)
    return (
        f"# found by a flight: session {session!r}\n"
        f"# covariance: from the fit, times its reduced chi-square {max(fit.reduced_chi_square, 1.0):.2f}, each sigma"
        f" raised by up to {worst:.2f} for errors\n# that last longer than a frame; and not below"
        f" {np.degrees(FLOOR_ROTATION_RAD):g}°, {FLOOR_POSITION_M * 1e3:g} mm and {FLOOR_CLOCK_S * 1e3:g} ms, because"
        " mounts settle, gears\n# play and stamps are rounded, which one flight does not show\n"
    )


def _row(before: Rig, after: Rig, fit: FlightFit, k: int, name: str, antenna_m: FloatArray | None) -> str:
    """Return one parameter's row; a rotation has no value of its own but the change since the start."""
    change, sigma = float(fit.change[k]), float(fit.sigma[k])
    station, _, short = name.partition(".")
    group, _, axis = short.partition(".")
    value: float | None
    unit, scale = "m", 1.0
    if group in ("runway_from_base", "head_from_camera"):
        unit, scale, value = "deg", float(np.degrees(1.0)), None
        if group == "runway_from_base" and "orientation" not in before[station].known:
            return f"{name:<34}{'found':>14}{scale * sigma:>12.5f}{'':>14}  {unit}"
    elif group == "ptu_position":
        value = float(after[station].ptu_position_m["xyz".index(axis)])
        change = value - float(before[station].ptu_position_m["xyz".index(axis)])
    elif group in ("camera_clock", "ptu_clock"):
        clock = (after[station].camera_clock if group == "camera_clock" else after[station].ptu_clock) or ClockModel()
        unit, scale, value = "s", 1.0, clock.offset_s
        if axis == "drift":
            unit, scale, value = "ppm", 1e6, clock.drift_ppm * 1e-6
    elif group in ("focal", "principal_point", "distortion"):
        lens = after[station].lens
        values = {"focal": lens.focal_px, "principal_point": lens.principal_point_px, "distortion": lens.distortion}
        place = ("k1", "k2", "p1", "p2", "k3").index(axis) if group == "distortion" else "xy".index(axis)
        unit, value = ("" if group == "distortion" else "px"), float(values[group][place])
    elif group == "readout":
        unit, value = "s", after[station].readout_s
    elif station == "dgps_antenna":
        value = change + (0.0 if antenna_m is None else float(antenna_m["xyz".index(group)]))
    else:
        unit, value = "s", change
    shown = "" if value is None else f"{scale * value:.5f}"
    return f"{name:<34}{shown:>14}{scale * sigma:>12.5f}{scale * change:>+14.5f}  {unit}"


def _gross_times(fit: FlightFit, name: str) -> str:
    station = fit.stations[name]
    t = fit.problem.looks[name].t_s[station.usable & ~station.kept]
    if not len(t):
        return ""
    more = ", …" if len(t) > _MOST_SPANS else ""
    return " (gross at " + ", ".join(f"{s:.2f}" for s in t[:_MOST_SPANS]) + more + " s)"


def _verdict(after: Rig, fit: FlightFit) -> list[str]:
    """Say which parameters are determined, what goes together, and what the rig is good for."""
    prior = fit.problem.prior_sigma
    weak = [n for n, s, p in zip(fit.problem.names, fit.sigma, prior, strict=True) if s > _TAUGHT * p]
    lines = ["verdict:"]
    good = len(fit.problem.names) - len(weak)
    lines.append(f"  {good} of {len(fit.problem.names)} parameters are determined by this flight")
    if weak:
        lines.append("  not determined, hardly better known than before: " + ", ".join(weak))
    correlation = np.triu(fit.correlation, 1)
    order = np.argsort(-np.abs(correlation), axis=None)[:_MOST_PAIRS]
    for a, b in zip(*np.unravel_index(order, correlation.shape), strict=True):
        if abs(correlation[a, b]) > _BAD_CORRELATION:
            names = f"{fit.problem.names[a]} and {fit.problem.names[b]}"
            lines.append(f"  hard to tell apart: {names} (correlation {correlation[a, b]:+.3f})")
    condition = f"  condition {fit.condition:.1e}, reduced chi-square {fit.reduced_chi_square:.2f}"
    lines.append(condition + (": badly conditioned" if fit.condition > _MOST_CONDITION else ""))
    return [*lines, *_ranges(after, fit)]


def _ranges(after: Rig, fit: FlightFit) -> list[str]:
    """Say what one fix is off because of what is left of the calibration's error, at points of this flight."""
    problem = fit.problem
    if len(problem.stations) < 2:
        return []
    t = np.sort(np.concatenate([looks.t_s for looks in problem.looks.values()]))
    chosen = np.quantile(t, _SHARES)
    points = problem.track.at(chosen + problem.value(fit.change, "dgps_clock.offset"))
    middle = np.mean([s.ptu_position_m for s in after.stations], axis=0)
    lines = []
    for point, usable in zip(points.position_m, points.usable, strict=True):
        spread = _spread(after, problem, fit.covariance, point) if usable else None
        if spread is not None:
            away = float(np.linalg.norm(point - middle))
            x, y, z = spread
            lines.append(f"  at {away:.0f} m: one fix off by {x:.3f} / {y:.3f} / {z:.3f} m in x / y / z (1 sigma)")
    if not lines:
        return []
    return ["  what is left of the calibration's error, clocks apart, does to triangulation:", *lines]


def _spread(after: Rig, problem: FlightProblem, covariance: FloatArray, point: FloatArray) -> FloatArray | None:
    """Return one sigma (3,) of a triangulated point by the calibration's covariance."""
    by_point, by_change = [], []
    for name in problem.stations:
        geometry, pan, tilt = after[name].geometry(), 0.0, 0.0
        if not after[name].fixed:
            aim = aim_at(geometry, point)
            if aim is None:
                continue
            pan, tilt = aim.pan_rad, aim.tilt_rad
        seen = project_with_calibration(geometry, point, pan, tilt)
        if seen is None or not geometry.contains(seen.pixel):
            continue
        columns = np.zeros((2, len(problem.names)))
        for place, short in problem.own(name):
            if short in CALIBRATION_PARAMETERS:
                columns[:, place] = seen.calibration_jacobian[:, CALIBRATION_PARAMETERS.index(short)]
        by_point.append(seen.jacobian[:, :3])
        by_change.append(columns)
    if len(by_point) < 2:
        return None
    gain = np.linalg.pinv(np.vstack(by_point)) @ np.vstack(by_change)
    return np.asarray(np.sqrt(np.diag(gain @ covariance @ gain.T)))
