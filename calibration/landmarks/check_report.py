"""The result of a check, in a line for each station, and as a page."""

from pathlib import Path

import numpy as np

from calibration.landmarks.check import EFFECT_RANGE_M, Check, StationMovement
from calibration.landmarks.check_history import PastCheck, history_picture
from calibration.landmarks.check_pictures import check_pictures
from calibration.landmarks.survey_report import rejected
from calibration.report.picture import shown, write_page
from groundstation.files.html_page import (
    bullet_list,
    html_page,
    page_header,
    text_table,
    verdict_line,
)
from groundstation.rig.rig import Rig

_AXES = (("pan", 2), ("tilt", 0), ("roll", 1))
TABLE_HEAD = ("station", "pan", "tilt", "roll", "chi-square", "alarm above", "would have found, pan / tilt / roll")


def format_check(check: Check, alarm_deg: float, decision: str) -> str:
    """Return a line for each station, the omissions and the limits of the check."""
    lines = [station_line(check, m) for m in check.movements]
    lines += [f"{name}: not looked at, not checked" for name in check.unseen]
    lines += [f"left out: {text}" for text in rejected(check.fit)]
    lines += [f"note: {text}" for text in notes(check, alarm_deg)]
    return "\n".join([*lines, decision])


def station_line(check: Check, movement: StationMovement) -> str:
    """Return the verdict on one station."""
    parts = ", ".join(f"{axis} {_turn(movement, k)}" for axis, k in _AXES)
    if not movement.moved:
        return f"{movement.station}: as calibrated ({parts}; {len(movement.landmarks)} landmarks)"
    axis, k = max(_AXES, key=lambda pair: abs(movement.turned_rad[pair[1]]) / movement.sigma_rad[pair[1]])
    degrees = abs(float(np.degrees(movement.turned_rad[k])))
    along = check.along_m[movement.station]
    effect = "" if along is None else f": {along:.1f} m along the runway at {EFFECT_RANGE_M:g} m"
    what = "camera has turned on its head by" if movement.group == "head_from_camera" else "mount has turned"
    return f"{movement.station}: {what} {degrees:.3f} deg in {axis}{effect} ({parts})"


def notes(check: Check, alarm_deg: float) -> list[str]:
    """Return the limits of the check itself: movements that it would not detect."""
    found = []
    for movement in check.movements:
        least = np.degrees(movement.detectable_rad)
        blind = [f"{axis} {least[k]:.3f}" for axis, k in _AXES[:2] if least[k] > alarm_deg]
        if blind and not movement.moved:
            found.append(
                f"{movement.station}: a turn of {alarm_deg:g} deg could have been missed, this check detects "
                f"{' and '.join(blind)} deg: more readings, better or farther landmarks, or --reference"
            )
    if check.fit.raised > 1.0:
        found.append(
            f"residuals are {check.fit.raised:.1f} times what their noise allows: all sigmas are raised by that"
        )
    silent = [s.name for s in check.rig.stations if not _states_orientation(check.rig, s.name)]
    if silent:
        found.append(f"the rig states no covariance for the orientation of {', '.join(silent)}: taken as exact")
    return found


def _states_orientation(rig: Rig, name: str) -> bool:
    return any(n.startswith(f"{name}.runway_from_base.") for n in rig.calibration_covariance().names)


def _turn(movement: StationMovement, k: int) -> str:
    turned, sigma = np.degrees(movement.turned_rad[k]), np.degrees(movement.sigma_rad[k])
    return f"{turned:+.4f} ± {sigma:.4f} deg"


def table_rows(check: Check) -> list[tuple[str, ...]]:
    """Return the figures of every station as text."""
    return [
        (
            m.station,
            *(_turn(m, k) for _, k in _AXES),
            f"{m.statistic:.1f}",
            f"{m.threshold:.1f}",
            " / ".join(f"{np.degrees(m.detectable_rad[k]):.3f}" for _, k in _AXES) + " deg",
        )
        for m in check.movements
    ]


def write_check_report(
    folder: Path, check: Check, alarm_deg: float, decision: str, name: str, history: tuple[PastCheck, ...] = ()
) -> list[Path]:
    """Write report.html and its pictures into ``folder``, created if missing; returns the written files."""
    pictures = check_pictures(check, alarm_deg)
    drift = history_picture(history)
    pictures += [] if drift is None else [drift]
    body = "\n".join(
        [
            page_header("check before a session", name),
            verdict_line(decision),
            bullet_list([station_line(check, m) for m in check.movements]),
            "<h2>Where landmarks were seen</h2>" + shown(pictures),
            "<h2>Figures</h2>" + text_table(TABLE_HEAD, table_rows(check)),
            "<h2>Notes</h2>" + bullet_list([*notes(check, alarm_deg), *rejected(check.fit)] or ["none"]),
        ]
    )
    return write_page(folder, html_page(f"{name} – check", body), pictures)
