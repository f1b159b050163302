"""The text report of a flight's calibration: a table of parameters, the residuals and the accuracy to expect."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.flight.fit import FlightFit
from calibration.flight.parameters import FLOOR_CLOCK_S, FLOOR_POSITION_M, FLOOR_ROTATION_RAD
from calibration.flight.problem import ANTENNA
from calibration.flight.verdict import FlightVerdict, range_lines
from groundstation.rig.rig import ClockModel, Rig
from groundstation.session.antenna import AntennaPosition

_MOST_SPANS = 12


def lasting_lines(fit: FlightFit) -> list[str]:
    """Return a line on the error of the fixes that lasts; none where the fixes have no such error."""
    return [part.lasting.text for part in fit.parts if part.lasting is not None][:1]


def antenna_line(fit: FlightFit, antenna: AntennaPosition) -> str:
    """Return a line on where the DGPS antenna was taken to be, by what, and whether the flight has estimated it."""
    estimated = ANTENNA[0] in fit.problem.names
    where = f"{antenna.words}, by {antenna.source.value}"
    if antenna.in_body_m is None:
        where = f"taken for the nose, as {antenna.source.value} states it"
    how = "estimated from there on" if estimated else "held"
    if not estimated and antenna.sigma_m is not None and antenna.sigma_m.any():
        sigma = ", ".join(f"{v:g}" for v in antenna.sigma_m)
        how = (
            f"held, though its sigmas there are {sigma} m (`calibrate flight --free antenna` estimates it within them)"
        )
    return f"DGPS antenna: {where}; {how}"


def format_flight_report(
    before: Rig,
    after: Rig,
    fit: FlightFit,
    excluded: Sequence[str],
    antenna: AntennaPosition,
    verdict: FlightVerdict,
) -> str:
    """Return the whole report: parameters, residuals, exclusions, verdict."""
    lines = [f"{'parameter':<34}{'value':>14}{'sigma':>12}{'change':>14}  unit"]
    for k, name in enumerate(fit.problem.names):
        row = parameter_row(before, after, fit, k)
        lines.append(f"{name:<34}{row.value:>14}{row.sigma:>12}{row.change:>14}  {row.unit}")
    lines.append("")
    for name, station in fit.stations.items():
        usable, kept, count = int(station.usable.sum()), int(station.kept.sum()), len(station.usable)
        lines.append(
            f"{name}: {station.rms_px:.2f} px rms over {kept} pixels; {usable - kept} gross, "
            f"{count - usable} without angle or DGPS{gross_times(fit, name)}"
        )
    lines += [*lasting_lines(fit), antenna_line(fit, antenna)]
    if fit.point_sigma_m > 0.0:
        lines.append(
            f"in the sigmas: the point seen may lie {fit.point_sigma_m:g} m along the body from where it is taken to be"
            " (--point-sigma)"
        )
    lines += [f"left out: {text}" for text in excluded[:_MOST_SPANS]]
    if len(excluded) > _MOST_SPANS:
        lines.append(f"left out: {len(excluded) - _MOST_SPANS} more stretches of DGPS")
    return "\n".join([*lines, "", *_verdict_lines(verdict)])


def rig_header(session: str, fit: FlightFit) -> str:
    """Return the comment at the head of the rig file: its origin and the reason of its sigmas."""
    worst = max(float(fit.lasting_factor.max()), 1.0)
    return (
        f"# found by a flight: session {session!r}\n"
        f"# covariance: from the fit, times its reduced chi-square {max(fit.reduced_chi_square, 1.0):.2f}, each sigma"
        f" raised by up to {worst:.2f} for errors\n# that last longer than a frame; and not below"
        f" {np.degrees(FLOOR_ROTATION_RAD):g}°, {FLOOR_POSITION_M * 1e3:g} mm and {FLOOR_CLOCK_S * 1e3:g} ms, because"
        " mounts settle, gears\n# play and stamps are rounded, which one flight does not show\n"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRow:
    """One parameter, formatted; ``value`` and ``change`` may be empty."""

    value: str
    sigma: str
    change: str
    unit: str


def parameter_row(before: Rig, after: Rig, fit: FlightFit, k: int) -> ParameterRow:
    """Return one parameter's row; a rotation has no value of its own but the change since the start."""
    name = fit.problem.names[k]
    change, sigma = float(fit.change[k]), float(fit.sigma[k])
    station, _, short = name.partition(".")
    group, _, axis = short.partition(".")
    value: float | None
    unit, scale = "m", 1.0
    if group in ("runway_from_base", "head_from_camera"):
        unit, scale, value = "deg", float(np.degrees(1.0)), None
        if group == "runway_from_base" and "orientation" not in before[station].known:
            return ParameterRow(value="found", sigma=f"{scale * sigma:.5f}", change="", unit=unit)
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
        value = float(fit.problem.antenna_m(fit.change)["xyz".index(group)])
    else:
        unit, value = "s", change
    shown = "" if value is None else f"{scale * value:.5f}"
    return ParameterRow(value=shown, sigma=f"{scale * sigma:.5f}", change=f"{scale * change:+.5f}", unit=unit)


def gross_times(fit: FlightFit, name: str) -> str:
    """Return when a station's pixels were left out, in brackets; empty if none was."""
    station = fit.stations[name]
    t = fit.problem.observations[name].t_s[station.usable & ~station.kept]
    if not len(t):
        return ""
    more = ", …" if len(t) > _MOST_SPANS else ""
    return " (gross at " + ", ".join(f"{s:.2f}" for s in t[:_MOST_SPANS]) + more + " s)"


def _verdict_lines(verdict: FlightVerdict) -> list[str]:
    """Return the verdict: first the undetermined parameters, then the rig's quality and the next steps."""
    lines = ["verdict:", *(f"  {text}" for text in verdict.apart), f"  {verdict.summary}"]
    lines += [f"  {text}" for text in verdict.notes]
    if verdict.ranges:
        lines.append("  what is left of the calibration's error does to a fix, 1 sigma along / across / up:")
        lines += [f"    {text}" for text in range_lines(verdict.ranges)]
    return [*lines, "  to do next:", *(f"    - {text}" for text in verdict.next_steps)]
