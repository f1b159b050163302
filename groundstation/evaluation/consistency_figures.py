"""The report's pictures of consistency and of latency."""

from typing import TYPE_CHECKING

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.evaluate import Evaluation
from groundstation.evaluation.figure_style import (
    EKF,
    TRIANGULATION,
    ReportFigure,
    draw_dots,
    legend_above,
    shade_phases,
    stride,
)
from groundstation.evaluation.metrics import Comparison
from groundstation.geometry.chi_square import chi_square_quantile

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LATENCY = "latency"
_WINDOW_S = 2.0
_POSITION_DOF = 3.0


def consistency_pictures(e: Evaluation) -> list[ReportFigure]:
    """Return NEES against the best reference, NIS and latency, as far as the run has them."""
    shown = []
    best = next(((name, c) for name, c in e.comparisons.items() if c.ekf_known.any()), None)
    if best is not None:
        shown.append(_nees_picture(e, *best))
    judged = e.cameras[np.isfinite(e.cameras["nis"]) & e.cameras["accepted"]]
    if len(judged):
        mean = judged["nis"].astype(np.float64).sum() / max(float(judged["dof"].astype(np.float64).sum()), 1.0)
        shown.append(
            ReportFigure(
                name="nis",
                title="Are the innovations as large as the filter expects?",
                caption="Normalised innovation squares (NIS) of the accepted pixels per degree of freedom: single "
                f"values as dots, their mean over {_WINDOW_S:.0f} s as the line; it should lie in the grey band 95 % "
                "of the time. Below it, the filter expects more than there is.",
                alt=f"Over the whole run the mean is {mean:.2f}; 1 is ideal.",
                draw=lambda figure: _nis(figure, e),
                height_in=3.2,
            )
        )
    if np.any(e.epochs["latency_s"] > 0):
        shown.append(_latency_picture(e))
    return shown


def _nees_picture(e: Evaluation, name: str, comparison: Comparison) -> ReportFigure:
    words = {"truth": "the truth", "dgps": "DGPS"}.get(name, name)
    return ReportFigure(
        name="nees",
        title="Are the errors as large as the filter states?",
        caption=f"Normalised squared errors (NEES) against {words} per degree of freedom: single values as dots, their "
        f"mean over {_WINDOW_S:.0f} s as the line. The grey band holds the mean of independent errors 95 % of the "
        "time; errors of consecutive pairs are correlated, so an honest filter leaves it more often.",
        alt=f"Over the whole run the mean is {comparison.nees().mean() / _POSITION_DOF:.2f}; 1 is ideal.",
        draw=lambda figure: _nees(figure, e, comparison),
        height_in=3.2,
    )


def _nees(figure: "Figure", e: Evaluation, c: Comparison) -> None:
    """Draw NEES per degree of freedom over time."""
    nees = c.nees()
    _chi_square(figure, e, c.t_s[c.ekf_known], nees, np.full(len(nees), _POSITION_DOF), "NEES / freedom")


def _nis(figure: "Figure", e: Evaluation) -> None:
    """Draw NIS per degree of freedom over time."""
    rows = e.cameras[np.isfinite(e.cameras["nis"]) & e.cameras["accepted"]]
    rows = rows[np.argsort(rows["t_s"], kind="stable")]
    dof = rows["dof"].astype(np.float64)
    _chi_square(figure, e, rows["t_s"], rows["nis"].astype(np.float64), dof, "NIS / freedom")


def _chi_square(
    figure: "Figure", e: Evaluation, t_s: FloatArray, values: FloatArray, dof: FloatArray, name: str
) -> None:
    """Draw χ² values (n,) over time (n,), their running mean, and the mean's 95 % band."""
    ax = figure.subplots()
    lo = np.searchsorted(t_s, t_s - _WINDOW_S / 2)
    hi = np.searchsorted(t_s, t_s + _WINDOW_S / 2, side="right")
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (values, dof)]
    total, freedom = (s[hi] - s[lo] for s in sums)
    step = stride(len(t_s))
    band = chi_square_quantile(np.array([[0.025], [0.975]]), freedom[::step]) / freedom[::step]
    shade_phases(ax, e.run.phases, label=False)
    ax.fill_between(t_s[::step], band[0], band[1], color="#999999", alpha=0.3, lw=0, label="95 % band")
    draw_dots(ax, t_s[::step], (values / dof)[::step], 2.0, EKF, 0.35)
    ax.plot(t_s[::step], (total / freedom)[::step], color=EKF, label=f"mean over {_WINDOW_S:.0f} s")
    ax.axhline(1.0, color="#777777", lw=0.8)
    ax.set_ylim(0, max(4.0, 1.2 * float((total / freedom).max())))
    ax.set_xlabel("session time in s")
    ax.set_ylabel(name)
    legend_above(ax, 2)


def _latency_picture(e: Evaluation) -> ReportFigure:
    ms = 1e3 * e.epochs["latency_s"].astype(np.float64)
    p50, p99 = np.nanpercentile(ms, [50, 99])
    return ReportFigure(
        name=LATENCY,
        title="How long from picture to answer?",
        caption="Each pair's time from its first picture's arrival to its estimate; lines at the median and at 99 %.",
        alt=f"Median {p50:.1f} ms, 99 % within {p99:.1f} ms.",
        draw=lambda figure: _latency(figure, e, ms),
        height_in=3.0,
    )


def _latency(figure: "Figure", e: Evaluation, ms: FloatArray) -> None:
    """Draw the latency of each epoch."""
    ax = figure.subplots()
    shade_phases(ax, e.run.phases, label=False)
    step = stride(len(ms))
    draw_dots(ax, e.epochs["t_s"][::step], ms[::step], 2.5, EKF, 1.0)
    for percent, style in ((50, "-"), (99, "--")):
        value = float(np.nanpercentile(ms, percent))
        label = f"{'median' if percent == 50 else '99 %'} {value:.1f} ms"
        ax.axhline(value, color=TRIANGULATION, ls=style, label=label)
    ax.set_ylim(0, None)
    ax.set_xlabel("session time in s")
    ax.set_ylabel("ms")
    legend_above(ax, 2)
