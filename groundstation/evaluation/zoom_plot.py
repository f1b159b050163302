"""Plots of the report that can be zoomed: the data of its figures of errors and of the track, drawn by zoom_plot.js.

A picture of the page is wrapped with its data; the script draws them in the picture's place on a screen. Without
scripts, and in print, the picture is shown.
"""

import json
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.collector import TRACK_STATUSES, TRIANGULATION_STATUSES
from groundstation.evaluation.evaluate import Evaluation
from groundstation.evaluation.figure_style import DGPS, EKF, PHASE_COLOURS, SMOOTHED, TRIANGULATION
from groundstation.evaluation.metrics import Comparison
from groundstation.evaluation.position_series import BoolArray
from groundstation.messages import TrackStatus, TriangulationStatus

# a pair of a figure takes 60 bytes: of an hour's flight the page stays below 2 MB
MAX_POINTS = 4000
_METRES, _SECONDS = 4, 3
_AXIS_NAMES = ("x, sideways", "y, along the runway", "z, height")
# the page's own ink: black would not be seen on dark paper
_INK = "var(--ink)"
# colours are Okabe and Ito's; heights say the same without colour
_STATUS_LOOKS = {
    TrackStatus.SEARCHING: ("#999999", 0.2),
    TrackStatus.ACQUIRING: ("#56B4E9", 0.4),
    TrackStatus.LOST: ("#D55E00", 0.6),
    TrackStatus.COASTING: ("#E69F00", 0.8),
    TrackStatus.TRACKING: ("#009E73", 1.0),
}
_LEFT_OUT = "#888888"
# a panel is never less than this high, in m
_LEAST_PANEL_M = 0.005
ZOOM_CSS = """
.zoom{display:none}.zoom svg{display:block;width:auto;height:auto;max-width:none;touch-action:pan-y;cursor:grab;
font-size:12px;fill:var(--ink);outline-offset:2px}.zoom svg svg{cursor:inherit}
.zoom-bar{display:flex;flex-wrap:wrap;gap:.3rem .6rem;align-items:center;font-size:.85rem;margin:.2rem 0}
.zoom-bar button{font:inherit;color:inherit;background:none;border:1px solid var(--line);border-radius:4px;
padding:.1rem .5rem;cursor:pointer}.zoom-bar button[aria-pressed=false]{opacity:.45;text-decoration:line-through}
.zoom-bar .tools{margin-left:auto;display:flex;gap:.3rem}.zoom-bar .tools button{min-width:2rem}
.swatch{display:inline-block;width:.8rem;height:.8rem;margin-right:.35rem;border-radius:2px;vertical-align:-.05rem}
.tint{opacity:.35}.zoom .grid{stroke:var(--line);stroke-width:.7}.zoom .frame{fill:none;stroke:var(--line)}
.zoom .cursor{stroke:var(--soft);stroke-dasharray:3 3}.zoom .curve{fill:none;stroke-width:1.6;stroke-linejoin:round}
.zoom .wide{stroke-width:3.4;stroke-opacity:.35}
.zoom .dots{fill:none;stroke-width:3.4;stroke-linecap:round;stroke-opacity:.7}
.zoom-readout{min-height:1.5em;font-size:.85rem;font-variant-numeric:tabular-nums;max-width:none;margin:0}
@media screen{.zoomable.active .zoom{display:block}.zoomable.active>svg{display:none}
figure:has(>.zoomable.active){grid-column:1/-1}}
"""


def zoom_plots(evaluation: Evaluation) -> dict[str, str]:
    """Return the data of each figure that can be zoomed, as JSON, by the figure's name."""
    if not np.isfinite(evaluation.epochs["position_m"]).any():
        return {}
    plots = {"projection_xy": _projection(evaluation, 0), "projection_yz": _projection(evaluation, 2)}
    for name, comparison in evaluation.comparisons.items():
        if comparison.ekf_known.any():
            plots[f"errors_{name}"] = _errors(evaluation, comparison, hatched=name == "dgps")
    # no "</script>" of a session's text ends the element early
    return {name: json.dumps(plot, allow_nan=False).replace("<", "\\u003c") for name, plot in plots.items()}


def zoomable(picture: str, plot: str | None) -> str:
    """Return a ``picture`` (an SVG element) with the data of the plot that takes its place; itself without data."""
    if plot is None:
        return picture
    return f"<div class='zoomable'>{picture}<script type='application/json'>{plot}</script></div>"


@cache
def zoom_script() -> str:
    """Return the element with the script; it follows the page's plots."""
    text = resources.files("groundstation.evaluation").joinpath("zoom_plot.js").read_text(encoding="utf-8")
    return f"<script>\n{text}</script>"


def _errors(e: Evaluation, c: Comparison, *, hatched: bool) -> dict[str, Any]:
    """Return the errors (n, 3) of one reference over time, with ±2 σ; ``hatched`` marks what is left out of DGPS."""
    step = _stride(len(c.t_s))
    known, seen = c.ekf_known[::step], c.triangulation_known[::step]
    panels = []
    for axis, label in enumerate(_AXIS_NAMES):
        two_sigma = 2.0 * np.sqrt(np.maximum(c.covariance_m2[::step, axis, axis], 0.0))
        series = [
            _series("±2 σ", "band", EKF, two_sigma, known),
            _series("triangulation", "dots", TRIANGULATION, c.triangulation_error_m[::step, axis], seen),
            _series("EKF", "line", EKF, c.ekf_error_m[::step, axis], known),
        ]
        panels.append({"label": f"{label.partition(',')[0]} in m", "least": _LEAST_PANEL_M, "series": series})
    spans = [
        {
            "from": phase.from_s,
            "to": phase.to_s,
            "name": phase.background,
            "colour": PHASE_COLOURS.get(phase.background, "#999999"),
        }
        for phase in e.run.phases
    ]
    if hatched and e.reference is not None:
        spans += [
            {"from": s.from_s, "to": s.to_s, "name": "left out", "colour": _LEFT_OUT}
            for s in e.reference.excluded
            if s.to_s >= c.t_s[0] and s.from_s <= c.t_s[-1]
        ]
    time = {"label": "session time in s", "short": "t", "unit": "s", "values": _numbers(c.t_s[::step], _SECONDS)}
    return _plot(e, time, panels, spans, step)


def _projection(e: Evaluation, axis: int) -> dict[str, Any]:
    """Return one coordinate of the track over the distance y: triangulation, references, EKF, smoothed track."""
    step = _stride(len(e.epochs))
    rows = e.epochs[::step]
    known = np.isfinite(rows["position_m"]).all(axis=1)
    triangulated = rows["triangulation_status"] == TRIANGULATION_STATUSES.index(TriangulationStatus.OK)
    series = [_placed("triangulation", "dots", TRIANGULATION, rows["ml_point_m"][triangulated], axis)]
    if e.truth is not None:
        truth = e.truth.position_m[:: _stride(len(e.truth))]
        series.append({**_placed("truth", "line", _INK, truth, axis), "wide": True})
    if e.reference is not None:
        fixes = e.reference.all_fixes.position_m[:: _stride(len(e.reference.all_fixes))]
        series.append(_placed("DGPS", "dots", DGPS, fixes, axis))
    series.append(_series("EKF", "line", EKF, rows["position_m"][:, axis], known))
    if e.smoothed is not None:
        later = e.smoothed["position_m"][::step]
        series.append(_series("smoothed", "line", SMOOTHED, later[:, axis], np.isfinite(later[:, axis])))
    place = np.where(known, rows["position_m"][:, 1], np.nan)
    distance = {"label": "y, along the runway, in m", "short": "y", "unit": "m", "values": _numbers(place, _METRES)}
    panel = {"label": f"{_AXIS_NAMES[axis]}, in m", "least": _LEAST_PANEL_M, "series": series}
    return _plot(e, distance, [panel], [], step)


def _plot(
    e: Evaluation, x: dict[str, Any], panels: list[dict[str, Any]], spans: list[dict[str, Any]], step: int
) -> dict[str, Any]:
    """Return a plot with the track's status at each ``step`` pairs."""
    words = [{"name": str(s), "colour": _STATUS_LOOKS[s][0], "height": _STATUS_LOOKS[s][1]} for s in TRACK_STATUSES]
    return {
        "x": x,
        "panels": panels,
        "spans": spans,
        "status": {"codes": e.epochs["status"][::step].tolist(), "words": words},
        "note": "" if step == 1 else f" One pair in {step} is drawn.",
    }


def _series(name: str, kind: str, colour: str, values: FloatArray, known: BoolArray) -> dict[str, Any]:
    """Return one value of each pair; nothing where it is not known."""
    shown = np.where(known, values, np.nan)
    return {"name": name, "kind": kind, "colour": colour, "y": _numbers(shown, _METRES)}


def _placed(name: str, kind: str, colour: str, places_m: FloatArray, axis: int) -> dict[str, Any]:
    """Return places (n, 3) of their own, one coordinate over y."""
    known: BoolArray = np.asarray(np.isfinite(places_m).all(axis=1))
    x = _numbers(np.where(known, places_m[:, 1], np.nan), _METRES)
    return {**_series(name, kind, colour, places_m[:, axis], known), "x": x}


def _numbers(values: FloatArray, digits: int) -> list[float | None]:
    """Return numbers for JSON, rounded; null where there is none."""
    shown = np.round(np.asarray(values, dtype=np.float64), digits)
    return [v if known else None for v, known in zip(shown.tolist(), np.isfinite(shown).tolist(), strict=True)]


def _stride(n: int) -> int:
    """Return the step that leaves at most `MAX_POINTS` of ``n``."""
    return max(1, -(-n // MAX_POINTS))
