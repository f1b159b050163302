"""The pictures of report.html: no window system, no global plotting state, a palette for all eyes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.checked_reference import CheckedReference
from groundstation.evaluation.collector import TRIANGULATION_STATUSES
from groundstation.evaluation.consistency_figures import consistency_pictures
from groundstation.evaluation.evaluate import Evaluation
from groundstation.evaluation.figure_style import (
    BOUND,
    DGPS,
    EKF,
    SMOOTHED,
    TRIANGULATION,
    TRUTH,
    ReportFigure,
    draw_dots,
    gapped,
    legend_above,
    reserve_rows,
    shade_phases,
    stride,
)
from groundstation.evaluation.metrics import Comparison, in_bin, range_bins
from groundstation.messages import TriangulationStatus

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_AXES = ("x", "y", "z")
_AXIS_NAMES = ("x, sideways", "y, along the runway", "z, height")


def pictures(evaluation: Evaluation, edges_m: Sequence[float]) -> list[ReportFigure]:
    """Return every picture that the run has data for."""
    if not len(evaluation.epochs):
        return []
    shown = [
        _projection_picture(evaluation, 0, "xy", "Seen from above", "The track in the runway frame, x against y."),
        _projection_picture(evaluation, 2, "yz", "Seen from the side", "Height against the distance along the runway."),
    ]
    for name, comparison in evaluation.comparisons.items():
        if comparison.ekf_known.any():
            shown.append(_error_picture(evaluation, name, comparison))
    best = next(iter(evaluation.comparisons.items()), None)
    if evaluation.bounds.fix_known.any():
        shown.append(_bound_picture(evaluation, best, edges_m))
    return shown + consistency_pictures(evaluation)


def _projection_picture(e: Evaluation, axis: int, name: str, title: str, caption: str) -> ReportFigure:
    """Draw one coordinate over y."""
    known = np.isfinite(e.epochs["position_m"]).all(axis=1)
    place = e.epochs["position_m"][known]
    alt = "The EKF has no estimate."
    if len(place):
        low, high = place.min(axis=0), place.max(axis=0)
        alt = (
            f"The EKF's track runs from y {high[1]:.0f} to {low[1]:.0f} m, "
            f"{_AXES[axis]} from {low[axis]:.1f} to {high[axis]:.1f} m."
        )
    return ReportFigure(
        name=f"projection_{name}",
        title=title,
        caption=f"{caption} The axes have different scales.",
        alt=alt,
        draw=lambda figure: _projection(figure, e, axis),
        height_in=3.4,
    )


def _projection(figure: "Figure", e: Evaluation, axis: int) -> None:
    """Draw one coordinate over y: triangulation, references, track."""
    ax = figure.subplots()
    step = stride(len(e.epochs))
    rows = e.epochs[::step]
    ok = rows["triangulation_status"] == TRIANGULATION_STATUSES.index(TriangulationStatus.OK)
    known = np.isfinite(rows["position_m"]).all(axis=1)
    points = rows["ml_point_m"][ok]
    draw_dots(ax, points[:, 1], points[:, axis], 2.5, TRIANGULATION, 0.6, "triangulation")
    if e.truth is not None:
        t = e.truth.position_m[:: stride(len(e.truth))]
        ax.plot(t[:, 1], t[:, axis], color=TRUTH, lw=2.6, alpha=0.35, label="truth")
    if e.reference is not None:
        d = e.reference.all_fixes.position_m[:: stride(len(e.reference.all_fixes))]
        ax.plot(d[:, 1], d[:, axis], "+", ms=4, mew=0.8, color=DGPS, label="DGPS")
    ax.plot(gapped(rows["position_m"][:, 1], known), rows["position_m"][:, axis], color=EKF, label="EKF")
    if e.smoothed is not None:
        later = e.smoothed["position_m"][::step]
        ax.plot(later[:, 1], later[:, axis], ls=(0, (4, 2)), lw=1.1, color=SMOOTHED, label="smoothed")
    ax.set_xlabel("y in m")
    ax.set_ylabel(f"{_AXES[axis]} in m")
    shown = np.concatenate([rows["position_m"][known][:, axis], points[:, axis]])
    if len(shown):
        low, high = np.percentile(shown, [0.5, 99.5])
        room = max(0.15 * (high - low), 0.2)
        ax.set_ylim(low - room, high + room)
    legend_above(ax, 3)


def _hatch_excluded(ax: "Axes", reference: CheckedReference | None, t_s: FloatArray, label: bool) -> None:
    """Hatch the spans of the reference that are not compared with, of those between the first and last time (n,)."""
    excluded = reference.excluded if reference is not None else ()
    spans = [span for span in excluded if span.to_s >= t_s[0] and span.from_s <= t_s[-1]]
    for k, span in enumerate(spans):
        name = "left out" if label and k == 0 else None
        to_s = max(span.to_s, span.from_s + 0.05)
        ax.axvspan(span.from_s, to_s, facecolor="none", edgecolor="#888888", hatch="////", lw=0, label=name)


def _error_picture(e: Evaluation, name: str, comparison: Comparison) -> ReportFigure:
    """Draw the errors against one reference."""
    words = {"truth": "the truth", "dgps": "DGPS"}.get(name, name)
    rmse = np.sqrt((comparison.ekf_error_m[comparison.ekf_known] ** 2).mean(axis=0))
    return ReportFigure(
        name=f"errors_{name}",
        title=f"Errors against {words}",
        caption="EKF minus reference with the band of ±2 σ that the filter states (it should hold 95 % of the line), "
        "and triangulation as dots. Tints: the background behind the aircraft. Hatched: reference left out.",
        alt="Three panels, x, y and z over time. The EKF's root mean square errors are "
        f"{rmse[0]:.3f}, {rmse[1]:.3f} and {rmse[2]:.3f} m.",
        draw=lambda figure: _errors(figure, e, comparison, e.reference if name == "dgps" else None),
        height_in=5.6,
    )


def _errors(figure: "Figure", e: Evaluation, c: Comparison, reference: CheckedReference | None) -> None:
    """Draw error over time with ±2σ, one panel per axis; what is left out of ``reference`` is hatched."""
    panels = figure.subplots(3, 1, sharex=True)
    step = stride(len(c.t_s))
    t, known, seen = c.t_s[::step], c.ekf_known[::step], c.triangulation_known[::step]
    for axis, ax in enumerate(panels):
        sigma = np.sqrt(np.where(known, np.maximum(c.covariance_m2[::step, axis, axis], 0.0), np.nan))
        error = c.ekf_error_m[::step, axis]
        shade_phases(ax, e.run.phases, label=axis == 0)
        _hatch_excluded(ax, reference, c.t_s, label=axis == 0)
        ax.fill_between(t, -2 * sigma, 2 * sigma, color=EKF, alpha=0.22, lw=0, label="±2 σ" if axis == 0 else None)
        triangulated = c.triangulation_error_m[::step, axis][seen]
        draw_dots(ax, t[seen], triangulated, 2.2, TRIANGULATION, 0.7, "triangulation" if axis == 0 else "")
        ax.plot(t, gapped(error, known), color=EKF, label="EKF")
        reach = max(np.percentile(np.abs(error[known]), 99), np.nanpercentile(2 * sigma, 98), 0.01)
        ax.set_ylim(-1.3 * reach, 1.3 * reach)
        ax.set_ylabel(f"{_AXES[axis]} in m")
    panels[-1].set_xlabel("session time in s")
    legend_above(panels[0], 3)


def _bound_picture(e: Evaluation, best: tuple[str, Comparison] | None, edges_m: Sequence[float]) -> ReportFigure:
    """Draw sigmas and errors over range against the bounds."""
    sigma = np.sqrt((e.bounds.fix_sigma_m[e.bounds.fix_known] ** 2).mean(axis=0))
    return ReportFigure(
        name="bounds",
        title="How close to what is possible?",
        caption="Over the range y: the lower bound of one fix (Cramér-Rao, one angle reading each), the lower bound "
        "of the track so far (posterior) and the sigma the filter states (lines), and the errors in each range bin "
        "(markers). Markers on the line of their bound are as good as the pixel noise that the detector states "
        "allows; below it, the detector states too much.",
        alt="Three panels, x, y and z over the range, logarithmic. The bound of one fix is "
        f"{sigma[0]:.3f}, {sigma[1]:.3f} and {sigma[2]:.3f} m rms.",
        draw=lambda figure: _bound_panels(figure, e, best, edges_m),
        height_in=6.2,
    )


def _bound_panels(
    figure: "Figure", e: Evaluation, best: tuple[str, Comparison] | None, edges_m: Sequence[float]
) -> None:
    """Draw one panel per axis, sigma over range, logarithmic."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    panels = figure.subplots(3, 1, sharex=True)
    place = e.epochs["position_m"][:, 1]
    y = place if best is None else np.where(best[1].usable, best[1].reference_m[:, 1], place)
    step = stride(len(y))
    order = np.argsort(np.where(np.isfinite(y), y, np.inf))[::step]
    stated = np.sqrt(np.maximum(np.einsum("nii->ni", e.epochs["covariance_m2"].astype(np.float64)), 0.0))
    b = e.bounds
    for axis, ax in enumerate(panels):
        for values, known, colour, style, name in (
            (b.fix_sigma_m, b.fix_known, TRIANGULATION, ":", "bound, one fix"),
            (b.track_sigma_m, b.track_known, BOUND, "--", "bound, track"),
            (stated, np.isfinite(stated).all(axis=1), EKF, "-", "σ the EKF states"),
        ):
            ok = order[known[order] & np.isfinite(y[order])]
            ax.plot(y[ok], values[ok, axis], color=colour, ls=style, label=name, lw=1.3)
        if best is not None:
            _bin_markers(ax, best[1], axis, edges_m)
        ax.set_yscale("log")
        ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.yaxis.set_minor_locator(NullLocator())
        ax.set_ylabel(f"{_AXES[axis]} in m")
        ax.set_title(_AXIS_NAMES[axis], fontsize=9.5, loc="right", y=1.0, pad=2)
    panels[-1].set_xlabel("range y in m")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", ncols=2, columnspacing=1.2, handletextpad=0.5)
    reserve_rows(figure, -(-len(labels) // 2))


def _bin_markers(ax: "Axes", c: Comparison, axis: int, edges_m: Sequence[float]) -> None:
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
