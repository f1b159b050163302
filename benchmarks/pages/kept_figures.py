"""Figures of the sessions that the pages quote: taken from a replay's summary, and kept in two committed files."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.evaluation.key_figures import AXES, FigureChange, figures_of, group_names
from groundstation.rig.rig import load_rig
from pages.passages import ROOT

LANDING = "landing-1"
SIMULATED = "flights/one"
# the sessions of the pages: the bundled one, those of $GROUNDSTATION_DATA, and the one of docs/first-flight.md
ELSEWHERE = ("takeoff-1", "landing-clutter", "takeoff-away")
SESSIONS = (LANDING, *ELSEWHERE, SIMULATED)
LANDING_FOLDER = ROOT / "recordings" / "landing-1"
LANDING_FILE = ROOT / "recordings" / "landing-1.figures.json"
OTHER_FILE = ROOT / "benchmarks" / "pages" / "session_figures.json"
# another machine's floating point moves a contour by fractions of a pixel, not more
RELATIVE, ABSOLUTE = 0.05, 0.003
_WATCHED = re.compile(
    r"truth\.(all|y[\d.-]+)\.(common\.)?(ekf|triangulation)\.rmse_._m|truth\.all\.ekf\.(anees|coverage)"
    r"|nis\.all\.mean|dgps_clock\.offset_s|pairs\.tracking|detections\.[^.]+\.ok"
)
# the pages quote y 100–250 m as one range
_POOLED, _PARTS = "truth.y100-250", ("y100-150", "y150-250")
# what an angle of pan between the stations of the bundled landing is along the runway: y²/baseline × angle
RULE, _RULE_DEG, _RULE_Y_M = "0.01° of relative pan at 400 m", 0.01, 400.0

# how late the DGPS of rendered sessions was made
_CLOCK_S = {LANDING: 0.300, "takeoff-1": 0.150}

Figures = dict[str, float]


def figures(summary: Mapping[str, Any]) -> Figures:
    """Return the figures of a summary.json that are watched or quoted, by name, with five decimals."""
    found = {name: value for name, value in figures_of(summary).items() if _WATCHED.fullmatch(name)}
    found |= _of_the_pages(summary)
    return {name: round(value, 5) for name, value in found.items()}


def _of_the_pages(summary: Mapping[str, Any]) -> Figures:
    """Return what is quoted and is not among a summary's key figures."""
    truth, nis = summary["accuracy"]["truth"], summary["nis"]["all"]
    found = {"nis.all.low_95": nis["low_95"], "nis.all.high_95": nis["high_95"], "nis.all.count": nis["count"]}
    for axis, ratio in zip(AXES, truth["total"]["bound"]["ekf_over_track"], strict=True):
        found[f"truth.all.ekf.over_bound_{axis}"] = ratio
    if summary["reference"]["time_offset"] is not None:
        found["dgps_clock.sigma_s"] = summary["reference"]["time_offset"]["sigma_s"]
    groups = {name: group for name, group in group_names(truth) if name not in truth["by_phase"]}
    found |= {f"truth.{name}.common.epochs": group["common"]["epochs"] for name, group in groups.items()}
    found |= _pooled([groups[name] for name in _PARTS])
    return {name: float(value) for name, value in found.items()}


def _pooled(parts: Sequence[Mapping[str, Any]]) -> Figures:
    """Return errors and ANEES of ranges taken together."""
    epochs, found = [part["common"]["epochs"] for part in parts], Figures()
    for method in ("ekf", "triangulation"):
        for k, axis in enumerate(AXES):
            squares = [n * part["common"][f"{method}_rmse_m"][k] ** 2 for n, part in zip(epochs, parts, strict=True)]
            found[f"{_POOLED}.common.{method}.rmse_{axis}_m"] = (sum(squares) / sum(epochs)) ** 0.5
    weights = [part["ekf"]["epochs"] for part in parts]
    weighted = [n * part["anees"] for n, part in zip(weights, parts, strict=True)]
    return found | {f"{_POOLED}.ekf.anees": sum(weighted) / sum(weights)}


def agrees(new: float, old: float) -> bool:
    """Return whether a figure is the kept one, within what another machine's floating point moves."""
    return FigureChange(before=old, after=new).within(RELATIVE, ABSOLUTE)


def moved(old: Mapping[str, float], new: Mapping[str, float]) -> list[str]:
    """Return the names of figures that are not within tolerance, or in one of the two alone."""
    names = {**old, **new}
    return [name for name in names if name not in old or name not in new or not agrees(new[name], old[name])]


def kept() -> dict[str, Figures]:
    """Return the kept figures by session."""
    other: dict[str, Figures] = json.loads(OTHER_FILE.read_text(encoding="utf-8")) if OTHER_FILE.is_file() else {}
    return {LANDING: json.loads(LANDING_FILE.read_text(encoding="utf-8")), **other}


def quotable(found: Mapping[str, Figures]) -> dict[str, Figures]:
    """Return the figures by session with what follows from them.

    By how much the filter is better than triangulation, how far off the DGPS clock is, the rule for pan.
    """
    quoted = {session: {**figures, **_better(figures)} for session, figures in found.items()}
    for session, made_with_s in _CLOCK_S.items():
        clock = quoted.get(session, {})
        if clock:
            off_s = abs(clock["dgps_clock.offset_s"] - made_with_s)
            clock["dgps_clock.sigmas_off"] = off_s / clock["dgps_clock.sigma_s"]
    left, right = (station.ptu_position_m for station in load_rig(LANDING_FOLDER / "rig.toml").stations)
    rule_m = _RULE_Y_M**2 * math.radians(_RULE_DEG) / float(np.hypot(*(right - left)[:2]))
    return {**quoted, RULE: {"y_m": rule_m}}


def _better(figures: Figures) -> Figures:
    """Return by how many per cent the filter's errors are smaller than the triangulation's on the same pairs."""
    found = {}
    for name, error in figures.items():
        match = re.fullmatch(r"(truth\.[^.]+\.common\.)ekf\.rmse_(.)_m", name)
        if match:
            other = figures[f"{match[1]}triangulation.rmse_{match[2]}_m"]
            found[f"{match[1]}better_{match[2]}_percent"] = 100.0 * (1.0 - error / other)
    return found


def keep(found: Mapping[str, Figures]) -> None:
    """Write both files."""
    LANDING_FILE.write_text(json.dumps(found[LANDING], indent=1) + "\n", encoding="utf-8")
    other = {session: found[session] for session in SESSIONS if session != LANDING and session in found}
    OTHER_FILE.write_text(json.dumps(other, indent=1) + "\n", encoding="utf-8")


def summary_of(folder: Path) -> dict[str, Any]:
    """Return the summary that a replay has left in its folder."""
    document: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return document
