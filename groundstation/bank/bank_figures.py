"""The figures of a bank's page: cumulative distributions over sessions, and hits by class."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from groundstation.bank.factor_figures import ClassFigures
from groundstation.bank.pooled_figures import session_values
from groundstation.bank.result_table import Row
from groundstation.evaluation.figure_style import BOUND, EKF, TRIANGULATION, ReportFigure, legend_above

_BASELINE = TRIANGULATION
_MOST_CLASSES = 24


def bank_figures(rows: Sequence[Row], classes: Sequence[ClassFigures]) -> list[ReportFigure]:
    """Return the figures for which the rows have data."""
    found = [
        _cumulative(rows, "hit", "Hits", "share of visible frames hit", ("hit_share", "baseline_hit_share")),
        _cumulative(rows, "covered", "Coverage", "share of epochs with an estimate", ("coverage", "baseline_coverage")),
        _cumulative(rows, "anees", "Consistency", "ANEES while tracking", ("anees", "baseline_anees"), log=True),
        _cumulative(
            rows, "error", "Error along the runway", "RMSE y, m", ("near_rmse_y_m", "baseline_near_rmse_y_m"), log=True
        ),
    ]
    if classes:
        found.append(_classes(classes))
    return [figure for figure in found if figure is not None]


def _cumulative(
    rows: Sequence[Row], name: str, title: str, label: str, columns: tuple[str, str], log: bool = False
) -> ReportFigure | None:
    """Return the cumulative distributions of a figure and of the baseline's; None without any value."""
    values = {"Groundstation": session_values(rows, columns[0]), "baseline": session_values(rows, columns[1])}
    if not len(values["Groundstation"]):
        return None

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        for (series, found), colour in zip(values.items(), (EKF, _BASELINE), strict=True):
            if len(found):
                shown = np.maximum(found, 1e-3) if log else found
                ax.step(shown, np.arange(1, len(found) + 1) / len(found), where="post", color=colour, label=series)
        if log:
            ax.set_xscale("log")
        if name == "anees":
            ax.axvline(1.0, color=BOUND, lw=1.0, label="ideal")
        ax.set_xlabel(label)
        ax.set_ylabel("share of sessions below")
        ax.set_ylim(0.0, 1.02)
        legend_above(ax, 3)

    median = float(np.median(values["Groundstation"]))
    return ReportFigure(
        name=name,
        title=title,
        caption=f"Cumulative distribution over {len(values['Groundstation'])} sessions.",
        alt=f"Half of the sessions have at most {median:.3g}.",
        draw=draw,
        height_in=3.0,
    )


def _classes(classes: Sequence[ClassFigures]) -> ReportFigure:
    """Return the share of hits of the most harmful classes."""
    shown = list(classes[:_MOST_CLASSES])[::-1]

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        places = np.arange(len(shown))
        for place, figures in zip(places, shown, strict=True):
            if figures.low is not None and figures.high is not None:
                ax.plot([100.0 * figures.low, 100.0 * figures.high], [place, place], color=EKF, lw=1.2)
        ax.plot([100.0 * figures.hit for figures in shown], places, "o", ms=4, color=EKF)
        ax.set_yticks(places, [f"{figures.factor}: {figures.kind}" for figures in shown])
        ax.set_xlabel("visible frames hit, % (95 % interval)")

    worst = classes[0]
    return ReportFigure(
        name="classes",
        title="Weakest conditions",
        caption="Share of hits by class; above, those that cost most hits in all.",
        alt=f"The most harmful class is {worst.factor} {worst.kind} with {100 * worst.hit:.0f} % hit.",
        draw=draw,
        height_in=0.6 + 0.22 * len(shown),
        fitted=True,
    )
