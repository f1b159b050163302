"""The accuracy table that a replay prints at its end: plain text, aligned, at most 98 columns."""

import math
import textwrap
from typing import Any

from groundstation.evaluation.chi_square_words import describe_nees, describe_nis

_WIDTH = 98
_UNITS = (
    ("runway_from_base", "deg", 180.0 / math.pi),
    ("head_from_camera", "deg", 180.0 / math.pi),
    ("clock.offset", "ms", 1e3),
    ("clock.drift", "ppm", 1e6),
    ("ptu_position", "m", 1.0),
    ("camera_in_head", "m", 1.0),
    ("antenna", "m", 1.0),
    ("focal", "px", 1.0),
    ("principal_point", "px", 1.0),
)
_NAMES = {"truth": "against the truth", "dgps": "against DGPS"}
# an improvement measured on fewer epochs is not significant
FEW_EPOCHS = 10
_HEADER = (
    f"{'':<13}{'epochs':>7} │{'EKF x':>8}{'y':>7}{'z':>7} │{'triang. x':>10}{'y':>7}{'z':>7} │"
    f"{'better % x':>11}{'y':>6}{'z':>6}"
)


def format_accuracy_table(summary: dict[str, Any]) -> str:
    """Return the summary's accuracy, consistency and reference findings as text for a terminal."""
    blocks = [_title(summary)]
    blocks += [f"cannot be right: {line}" for line in summary.get("contradictions", ())]
    if summary.get("no_track"):
        blocks.append(summary["no_track"])
    first = True
    for name, table in summary["accuracy"].items():
        if table["total"]["ekf"]["epochs"] or table["total"]["triangulation"]["epochs"]:
            blocks.append(_accuracy_block(_NAMES.get(name, name), table, explained=first))
            first = first and not table["anees"]
    if not summary["accuracy"]:
        blocks.append("no reference: nothing to compare with")
    blocks.append(
        "\n".join(
            [
                *_reference_lines(summary["reference"], tracked=not summary.get("no_track")),
                *_calibration_lines(summary["calibration"]),
                *_consistency_lines(summary),
            ]
        )
    )
    blocks += [f"note: {fault}" for fault in summary["faults"]]
    lines = "\n\n".join(blocks).splitlines()
    return "\n".join(part for line in lines for part in _folded(line))


def _folded(line: str) -> list[str]:
    """Fold one line of prose at the table's width; the table's own rows fit."""
    if len(line) <= _WIDTH:
        return [line]
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.wrap(line, _WIDTH, subsequent_indent=indent, drop_whitespace=True)


def _title(summary: dict[str, Any]) -> str:
    """Return the first lines: what was processed, and how the track fared."""
    session = summary["session"]
    if not session["epochs"]:
        return f"{session['name']}: no epoch processed"
    length = session["to_s"] - session["from_s"]
    words = ", ".join(f"{n} {word}" for word, n in summary["counts"]["track"].items() if n)
    stations = ", ".join(session["stations"])
    return f"{session['name']}: {session['epochs']} epochs, {length:.1f} s, stations {stations}\ntrack: {words}"


def _accuracy_block(name: str, table: dict[str, Any], *, explained: bool = True) -> str:
    """Return one reference's rows: total, ranges, backgrounds; the meaning of NEES if it is to be ``explained``."""
    lines = [f"RMSE in m {name}, EKF and triangulation on the same epochs", _HEADER, "─" * len(_HEADER)]
    lines.append(_row("all", table["total"]))
    for group in table["by_range"]:
        upper = "" if group["to_m"] is None else f"{group['to_m']:.0f}"
        lines.append(_row(f"y {group['from_m']:.0f}–{upper} m", group))
    for background, group in table["by_phase"].items():
        if group["reference_epochs"]:
            lines.append(_row(background, group))
    ekf, triangulation = table["total"]["ekf"], table["total"]["triangulation"]
    lines.append(
        f"coverage: EKF {100 * ekf['coverage']:.1f} %, triangulation {100 * triangulation['coverage']:.1f} % "
        f"of {table['total']['reference_epochs']} epochs with a reference"
    )
    for method, own in (("EKF", ekf), ("triangulation", triangulation)):
        if own["rmse_m"]:
            numbers = f"RMSE {_triple(own['rmse_m'])}, mean {_triple(own['mean_m'])}, 95 % {_triple(own['p95_m'])} m"
            lines.append(f"{method} alone: {numbers}")
    ratio = table["total"]["bound"]["ekf_over_track"]
    if ratio:
        single = table["total"]["bound"]["triangulation_over_fix"]
        lines.append(
            f"RMSE / bound x y z: EKF {_ratios(ratio)} of the track's bound"
            + (f", triangulation {_ratios(single)} of one fix's" if single else "")
            + " (bounds by the pixel sigmas that the detector states; below 1 it states too much)"
        )
    anees = table["anees"]
    if anees:
        lines.append(describe_nees(anees, first=explained))
    if "smoothed" in table:
        lines.append(_smoothed_line(table["smoothed"]))
    return "\n".join(lines)


def _smoothed_line(smoothed: dict[str, Any]) -> str:
    """Return the line of the track smoothed over the whole flight."""
    if not smoothed["epochs"] or not smoothed["ekf_rmse_m"]:
        return "smoothed: no epoch with a reference"
    anees = smoothed["anees"]
    return (
        f"smoothed over the flight: RMSE {_triple(smoothed['rmse_m'])} m on {smoothed['epochs']} epochs, "
        f"EKF there {_triple(smoothed['ekf_rmse_m'])} m" + (f"; ANEES {anees['mean']:.2f}" if anees else "")
    )


def _row(name: str, group: dict[str, Any]) -> str:
    """Return one line of the table; a dash where there is no common epoch."""
    common = group["common"]
    if not common["epochs"]:
        gap = "–"
        return f"{name:<13}{0:>7} │{gap:>8}{gap:>7}{gap:>7} │{gap:>10}{gap:>7}{gap:>7} │{gap:>11}{gap:>6}{gap:>6}"
    e = [_metres(v) for v in common["ekf_rmse_m"]]
    t = [_metres(v) for v in common["triangulation_rmse_m"]]
    few = common["epochs"] < FEW_EPOCHS
    b = ["–" if few else f"{v:+.0f}" if v > -1000 else "<-999" for v in common["improvement_percent"]]
    return (
        f"{name:<13}{common['epochs']:>7} │{e[0]:>8}{e[1]:>7}{e[2]:>7} │{t[0]:>10}{t[1]:>7}{t[2]:>7} │"
        f"{b[0]:>11}{b[1]:>6}{b[2]:>6}"
    )


def _reference_lines(reference: dict[str, Any], *, tracked: bool) -> list[str]:
    """Return what is known of the DGPS: its clock offset and what was left out."""
    if not reference["fixes"]:
        return []
    offset = reference["time_offset"]
    if offset is None:
        return [f"DGPS: {reference['fixes']} fixes, {'not usable' if tracked else 'not compared without a track'}"]
    if offset["offset_s"] is None:
        lines = [f"DGPS clock: offset not found: {offset['reason']}"]
    else:
        one = reference["session_clock_is_dgps_clock"]
        used = ", not applied: by the session's word the clocks are one" if one else ""
        lines = [
            f"DGPS clock: t_dgps = t_session {offset['offset_s']:+.4f} s ± {1e3 * offset['sigma_s']:.1f} ms"
            f" (1 σ, from the {offset['from']}, {offset['epochs']} epochs){used}"
        ]
    for span in reference["excluded"]:
        lines.append(f"  left out {span['from_s']:.2f} … {span['to_s']:.2f} s: {span['reason']}, {span['detail']}")
    return lines


def _calibration_lines(calibration: dict[str, Any]) -> list[str]:
    """Return what the filter carried of the rig's errors, and what it estimated of them with the DGPS."""
    errors = calibration["errors"]
    until_s = calibration["learnt_until_s"]
    learnt = [e for e in errors if e["estimated"] and (until_s is not None or calibration["use"] == "estimate")]
    carried = ", ".join(e["name"] for e in errors if e not in learnt)
    lines = [f"carried with their uncertainty, not estimated: {carried}"] if carried else []
    if learnt:
        taught = "" if until_s is None else f" from DGPS until {until_s:.2f} s (with which it is not compared)"
        lines.append(f"learnt{taught}:")
    for error in learnt:
        unit, scale = shown_unit(error["name"])
        value, sigma, prior = (scale * error[key] for key in ("value", "sigma", "prior_sigma"))
        lines.append(f"  {error['name']:<34}{value:>+10.4f} ± {sigma:.4f} {unit}   (before: 0 ± {prior:.4f})")
    return lines


def shown_unit(name: str) -> tuple[str, float]:
    """Return the unit to print a carried error in, and what to multiply its value by."""
    for part, unit, scale in _UNITS:
        if part in name:
            return unit, scale
    return "", 1.0


def _consistency_lines(summary: dict[str, Any]) -> list[str]:
    """Return NIS and latency."""
    lines = []
    nis = summary["nis"]["all"]
    if nis["mean"] is not None:
        lines.append(describe_nis(nis))
    latency = summary["latency_ms"]
    if latency["p50"]:
        lines.append(
            f"latency: {latency['p50']:.1f} ms median, {latency['p99']:.1f} ms at 99 %, {latency['max']:.1f} ms worst"
        )
    return lines


def _metres(value: float) -> str:
    """Format metres with three significant digits, at least to the millimetre."""
    return f"{value:.3f}" if value < 10 else f"{value:.2f}" if value < 100 else f"{value:.0f}"


def _triple(values: list[float]) -> str:
    """Format x/y/z in metres."""
    return "/".join(_metres(v) for v in values)


def _ratios(values: list[float | None]) -> str:
    """Format three ratios."""
    return " ".join("–" if v is None else f"{v:.2f}" for v in values)
