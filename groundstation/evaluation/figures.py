"""The pictures of report.html, as SVG text: no window system, no global plotting state, a palette for all eyes."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from scipy.stats import chi2

from groundstation.arrays import FloatArray
from groundstation.evaluation.collector import TRIANGULATION_STATUSES
from groundstation.evaluation.evaluate import Evaluation
from groundstation.evaluation.metrics import Comparison, PhaseLike, in_bin, range_bins
from groundstation.evaluation.reference import CheckedReference
from groundstation.evaluation.series import BoolArray
from groundstation.messages import TriangulationStatus

# Okabe and Ito's palette, told apart with any colour vision
EKF, TRIANGULATION, DGPS, TRUTH, BOUND = "#0072B2", "#E69F00", "#009E73", "#000000", "#CC79A7"
_PHASE_SHADES = {"sky": "#56B4E9", "mixed": "#F0E442", "ground": "#8C6D46"}
_PHASE_ALPHA = 0.13
_WIDTH_IN = 6.2
MAX_POINTS = 1000
_NIS_WINDOW_S = 2.0
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "groundstation",
    "font.family": ["sans-serif"],
    "font.size": 10.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
}
_AXES = ("x", "y", "z")
_AXIS_NAMES = ("x, sideways", "y, along the runway", "z, height")


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """One figure of the report: ``svg`` text, its ``title``, and a ``caption`` that says what to see in it."""

    title: str
    caption: str
    svg: str


def pictures(evaluation: Evaluation, edges_m: Sequence[float]) -> list[Picture]:
    """Draw every picture that the run has data for."""
    if not len(evaluation.epochs):
        return []
    shown = [
        _picture(
            "Seen from above",
            "The track in the runway frame, x against y. The axes have different scales.",
            lambda figure: _projection(figure, evaluation, 0),
            3.4,
        ),
        _picture(
            "Seen from the side",
            "Height against the distance along the runway. The axes have different scales.",
            lambda figure: _projection(figure, evaluation, 2),
            3.4,
        ),
    ]
    for name, comparison in evaluation.comparisons.items():
        if comparison.ekf_known.any():
            shown.append(_error_picture(evaluation, name, comparison))
    if np.isfinite(evaluation.cameras["nis"]).any():
        shown.append(
            _picture(
                "Are the innovations as large as the filter expects?",
                f"Normalised innovation squares of the accepted pixels per degree of freedom: single values as dots, "
                f"their mean over {_NIS_WINDOW_S:.0f} s as the line; it should lie in the band 95 % of the time.",
                lambda figure: _nis(figure, evaluation),
                3.0,
            )
        )
    best = next(iter(evaluation.comparisons.items()), None)
    if evaluation.bounds.fix_known.any():
        shown.append(_bound_picture(evaluation, best, edges_m))
    return shown


def _picture(title: str, caption: str, draw: Callable[[Figure], None], height_in: float) -> Picture:
    """Draw one figure and return it as SVG."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
        draw(figure)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return Picture(title=title, caption=caption, svg=text[text.index("<svg") :])


def _stride(n: int) -> int:
    """Return the step that leaves at most `MAX_POINTS` of ``n``."""
    return max(1, -(-n // MAX_POINTS))


def _gapped(values: FloatArray, known: BoolArray) -> FloatArray:
    """Return values with NaN where unknown, so that the line is not drawn across."""
    return np.where(known, values, np.nan)


def _projection(figure: Figure, e: Evaluation, axis: int) -> None:
    """Draw one coordinate over y: triangulation, references, track."""
    ax = figure.subplots()
    step = _stride(len(e.epochs))
    rows = e.epochs[::step]
    ok = rows["triangulation_status"] == TRIANGULATION_STATUSES.index(TriangulationStatus.OK)
    known = np.isfinite(rows["position_m"]).all(axis=1)
    points = rows["ml_point_m"][ok]
    ax.plot(points[:, 1], points[:, axis], ".", ms=3, color=TRIANGULATION, alpha=0.6, label="triangulation")
    if e.truth is not None:
        t = e.truth.position_m[:: _stride(len(e.truth))]
        ax.plot(t[:, 1], t[:, axis], color=TRUTH, lw=2.6, alpha=0.35, label="truth")
    if e.reference is not None:
        d = e.reference.all_fixes.position_m[:: _stride(len(e.reference.all_fixes))]
        ax.plot(d[:, 1], d[:, axis], "+", ms=4, mew=0.8, color=DGPS, label="DGPS")
    ax.plot(_gapped(rows["position_m"][:, 1], known), rows["position_m"][:, axis], color=EKF, label="EKF")
    ax.set_xlabel("y in m")
    ax.set_ylabel(f"{_AXES[axis]} in m")
    shown = np.concatenate([rows["position_m"][known][:, axis], points[:, axis]])
    if len(shown):
        low, high = np.percentile(shown, [0.5, 99.5])
        room = max(0.15 * (high - low), 0.2)
        ax.set_ylim(low - room, high + room)
    _legend_above(ax, 4)


def _legend_above(ax: Axes, columns: int) -> None:
    """Put the legend in one line above the axes, where it hides nothing."""
    ax.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, columnspacing=1.2, handletextpad=0.5, markerscale=2
    )


def _shade_phases(ax: Axes, phases: Sequence[PhaseLike], label: bool) -> None:
    """Tint the background of each phase; each kind enters the legend once."""
    seen: set[str] = set()
    for phase in phases:
        name = phase.background if label and phase.background not in seen else None
        seen.add(phase.background)
        shade = _PHASE_SHADES.get(phase.background, "#999999")
        ax.axvspan(phase.from_s, phase.to_s, color=shade, alpha=_PHASE_ALPHA, lw=0, label=name)


def _hatch_excluded(ax: Axes, reference: CheckedReference | None, label: bool) -> None:
    """Hatch the spans of the reference that are not compared with."""
    spans = reference.excluded if reference is not None else ()
    for k, span in enumerate(spans):
        name = "left out" if label and k == 0 else None
        to_s = max(span.to_s, span.from_s + 0.05)
        ax.axvspan(span.from_s, to_s, facecolor="none", edgecolor="#888888", hatch="////", lw=0, label=name)


def _error_picture(e: Evaluation, name: str, comparison: Comparison) -> Picture:
    """Draw the errors against one reference."""
    words = {"truth": "the truth", "dgps": "DGPS"}.get(name, name)
    return _picture(
        f"Errors against {words}",
        "EKF minus reference with the band of ±2 σ that the filter states (it should hold 95 % of the line), and "
        "triangulation as dots. Tints: the background behind the aircraft. Hatched: reference left out.",
        lambda figure: _errors(figure, e, comparison, e.reference if name == "dgps" else None),
        5.6,
    )


def _errors(figure: Figure, e: Evaluation, c: Comparison, reference: CheckedReference | None) -> None:
    """Draw error over time with ±2σ, one panel per axis; what is left out of ``reference`` is hatched."""
    panels = figure.subplots(3, 1, sharex=True)
    step = _stride(len(c.t_s))
    t, known, seen = c.t_s[::step], c.ekf_known[::step], c.triangulation_known[::step]
    for axis, ax in enumerate(panels):
        sigma = np.sqrt(np.where(known, np.maximum(c.covariance_m2[::step, axis, axis], 0.0), np.nan))
        error = c.ekf_error_m[::step, axis]
        _shade_phases(ax, e.run.phases, label=axis == 0)
        _hatch_excluded(ax, reference, label=axis == 0)
        ax.fill_between(t, -2 * sigma, 2 * sigma, color=EKF, alpha=0.22, lw=0, label="±2 σ" if axis == 0 else None)
        triangulated = c.triangulation_error_m[::step, axis][seen]
        ax.plot(t[seen], triangulated, ".", ms=2.5, color=TRIANGULATION, alpha=0.7, label="triangulation")
        ax.plot(t, _gapped(error, known), color=EKF, label="EKF")
        reach = max(np.percentile(np.abs(error[known]), 99), np.nanpercentile(2 * sigma, 98), 0.01)
        ax.set_ylim(-1.3 * reach, 1.3 * reach)
        ax.set_ylabel(f"{_AXES[axis]} in m")
    panels[-1].set_xlabel("session time in s")
    _legend_above(panels[0], 4)


def _nis(figure: Figure, e: Evaluation) -> None:
    """Draw NIS per degree of freedom over time with the 95 % band of its running mean."""
    ax = figure.subplots()
    rows = e.cameras[np.isfinite(e.cameras["nis"]) & e.cameras["accepted"]]
    rows = rows[np.argsort(rows["t_s"], kind="stable")]
    t, nis, dof = rows["t_s"], rows["nis"].astype(np.float64), rows["dof"].astype(np.float64)
    lo = np.searchsorted(t, t - _NIS_WINDOW_S / 2)
    hi = np.searchsorted(t, t + _NIS_WINDOW_S / 2, side="right")
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (nis, dof)]
    total, freedom = (s[hi] - s[lo] for s in sums)
    step = _stride(len(t))
    band = chi2.ppf(np.array([[0.025], [0.975]]), freedom[::step]) / freedom[::step]
    _shade_phases(ax, e.run.phases, label=False)
    ax.fill_between(t[::step], band[0], band[1], color="#999999", alpha=0.3, lw=0, label="95 %")
    ax.plot(t[::step], (nis / dof)[::step], ".", ms=2, color=EKF, alpha=0.35)
    ax.plot(t[::step], (total / freedom)[::step], color=EKF, label="mean")
    ax.axhline(1.0, color="#444444", lw=0.8)
    ax.set_ylim(0, max(4.0, 1.2 * float((total / freedom).max())))
    ax.set_xlabel("session time in s")
    ax.set_ylabel("NIS / freedom")
    _legend_above(ax, 3)


def _bound_picture(e: Evaluation, best: tuple[str, Comparison] | None, edges_m: Sequence[float]) -> Picture:
    """Draw sigmas and errors over range against the bounds."""
    return _picture(
        "How close to what is possible?",
        "Over the range y: the lower bound of one fix (one angle reading each), the lower bound of the track so far "
        "and the sigma the filter states (lines), and the errors in each range bin (markers). Markers on the line of "
        "their bound are as good as the pixel noise that the detector states allows; below it, the detector states "
        "too much.",
        lambda figure: _bound_panels(figure, e, best, edges_m),
        6.0,
    )


def _bound_panels(figure: Figure, e: Evaluation, best: tuple[str, Comparison] | None, edges_m: Sequence[float]) -> None:
    """Draw one panel per axis, sigma over range, logarithmic."""
    panels = figure.subplots(3, 1, sharex=True)
    place = e.epochs["position_m"][:, 1]
    y = place if best is None else np.where(best[1].usable, best[1].reference_m[:, 1], place)
    step = _stride(len(y))
    order = np.argsort(np.where(np.isfinite(y), y, np.inf))[::step]
    stated = np.sqrt(np.maximum(np.einsum("nii->ni", e.epochs["covariance_m2"].astype(np.float64)), 0.0))
    b = e.bounds
    for axis, ax in enumerate(panels):
        for values, known, colour, name in (
            (b.fix_sigma_m, b.fix_known, TRIANGULATION, "bound, one fix"),
            (b.track_sigma_m, b.track_known, BOUND, "bound, track"),
            (stated, np.isfinite(stated).all(axis=1), EKF, "σ the EKF states"),
        ):
            ok = order[known[order] & np.isfinite(y[order])]
            ax.plot(y[ok], values[ok, axis], color=colour, label=name, lw=1.1)
        if best is not None:
            _bin_markers(ax, best[1], axis, edges_m)
        ax.set_yscale("log")
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.yaxis.set_minor_formatter(NullFormatter())
        ax.set_ylabel(f"{_AXES[axis]} in m")
        ax.set_title(_AXIS_NAMES[axis], fontsize=9.5, loc="right", pad=2)
    panels[-1].set_xlabel("range y in m")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=3, columnspacing=1.2, handletextpad=0.5)


def _bin_markers(ax: Axes, c: Comparison, axis: int, edges_m: Sequence[float]) -> None:
    """Mark the root mean square errors of each range bin at its mean range."""
    for errors, known, colour, marker, name in (
        (c.ekf_error_m, c.ekf_known, EKF, "o", "error, EKF"),
        (c.triangulation_error_m, c.triangulation_known, TRIANGULATION, "s", "error, triangulation"),
    ):
        at, size = [], []
        for low, high in range_bins(edges_m):
            inside = known & in_bin(c.reference_m[:, 1], low, high)
            if inside.any():
                at.append(float(c.reference_m[inside, 1].mean()))
                size.append(float(np.sqrt((errors[inside, axis] ** 2).mean())))
        ax.plot(at, size, marker, ms=5.5, color=colour, mec="white", mew=0.6, label=name)
