"""The pictures of a comparison: all runs on the same axes, in the style of a replay's report."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.comparison_panels import (
    AXES,
    LEGEND_COLUMNS,
    MOST_BANDS,
    NEES_WINDOW_S,
    PlottedErrors,
    draw_boxes,
    draw_distributions,
    draw_errors,
    draw_nees,
    draw_range,
    draw_tracks,
    run_styles,
)
from groundstation.evaluation.figure_style import ReportFigure
from groundstation.evaluation.run_series import RunSeries

TRACK_PLOTS = ("tracks_above", "tracks_side")
# each with the reference's name after it
ERROR_PLOTS = ("errors", "distribution", "boxes", "range", "nees")
_LEGEND_ROW_IN = 0.2


def overlap_in_time(runs: Sequence[RunSeries]) -> bool:
    """Return whether the tracks of the runs that have one share some time."""
    spans = [run.track.t_s[run.track.known][[0, -1]] for run in runs if run.track.known.any()]
    return not spans or max(span[0] for span in spans) <= min(span[1] for span in spans)


def comparison_pictures(runs: Sequence[RunSeries], references: Mapping[str, str]) -> list[ReportFigure]:
    """Return the pictures for which the runs have data; ``references`` gives the words for each reference's name.

    Times are session times, or since each run's first estimate where the runs have no time in common.
    """
    pictures: list[ReportFigure] = []
    common = overlap_in_time(runs)
    for name, words in references.items():
        plotted = [
            PlottedErrors(
                name=run.name,
                errors=errors,
                colour=colour,
                style=style,
                shift_s=0.0 if common else float(run.track.t_s[run.track.known][0]),
            )
            for run, (colour, style) in zip(runs, run_styles(len(runs)), strict=True)
            if (errors := run.errors(name)) is not None
        ]
        if plotted:
            clock = "session time in s" if common else "time since each run's first estimate in s"
            pictures += _error_pictures(plotted, name, words, clock)
    return [*pictures, *_track_pictures(runs)]


# ---------------------------------------------------------------------------------------------- tracks
def _track_pictures(runs: Sequence[RunSeries]) -> Iterator[ReportFigure]:
    """Yield the tracks from above and from the side."""
    if not any(run.track.known.any() for run in runs):
        return
    for axis, name, title in ((0, "above", "The tracks from above"), (2, "side", "The tracks from the side")):
        ends = [
            f"{run.name}: y {y.max():.0f} to {y.min():.0f} m"
            for run in runs
            if len(y := run.track.position_m[run.track.known, 1])
        ]
        yield ReportFigure(
            name=f"tracks_{name}",
            title=title,
            caption=f"{AXES[axis]} against the distance along the runway, with the references in grey. The axes have "
            "different scales.",
            alt="; ".join(ends) + ".",
            draw=partial(draw_tracks, runs=runs, axis=axis),
            height_in=_height(3.2, len(runs) + 1),
        )


# ---------------------------------------------------------------------------------------------- errors
def _error_pictures(plotted: Sequence[PlottedErrors], name: str, words: str, clock: str) -> Iterator[ReportFigure]:
    """Yield the pictures of the errors against one reference."""
    sizes = ", ".join(f"{p.name} {_rms(p.errors.distance_m):.3f} m" for p in plotted)
    bands = "shaded" if len(plotted) <= MOST_BANDS else "its edges as thin lines"
    yield ReportFigure(
        name=f"errors_{name}",
        title=f"Errors against {words} over time",
        caption=f"EKF minus reference of every run, and the ±2 σ that each states, {bands}: it should hold 95 % of the "
        "line. Last panel: the size of the error, and its stated root mean square as a thin line.",
        alt=f"Root mean square errors in 3-D: {sizes}.",
        draw=partial(draw_errors, plotted=plotted, clock=clock),
        height_in=_height(6.4, len(plotted)),
    )
    yield from _distribution_pictures(plotted, name, words, sizes)
    yield ReportFigure(
        name=f"range_{name}",
        title=f"Errors against {words} over range",
        caption="Root mean square errors in equal steps of the range y (markers), and what the filter states there "
        "(thin lines). Runs that cover other parts of the approach can be compared here.",
        alt=f"Root mean square errors in 3-D over all ranges: {sizes}.",
        draw=partial(draw_range, plotted=plotted),
        height_in=_height(6.4, len(plotted)),
    )
    means = [f"{p.name} {np.nanmean(values):.2f}" for p in plotted if np.isfinite(values := p.errors.nees()).any()]
    if means:
        yield ReportFigure(
            name=f"nees_{name}",
            title=f"Are the errors against {words} as large as stated?",
            caption="NEES: the squared error in units of the stated covariance, per degree of freedom, averaged over "
            f"{NEES_WINDOW_S:.0f} s. 1 is ideal, more is overconfident, less is cautious. The grey band holds the mean "
            f"of independent errors 95 % of the time, for as many pairs as {plotted[0].name} has; errors of "
            "consecutive pairs are correlated, so an honest filter leaves it more often.",
            alt=f"Means over the whole run: {', '.join(means)}.",
            draw=partial(draw_nees, plotted=plotted, clock=clock),
            height_in=_height(3.4, len(plotted)),
        )


def _distribution_pictures(
    plotted: Sequence[PlottedErrors], name: str, words: str, sizes: str
) -> Iterator[ReportFigure]:
    """Yield the cumulative distributions and the boxes; ``sizes`` has each run's root mean square error in words."""
    medians = ", ".join(f"{p.name} {np.nanmedian(p.errors.distance_m):.3f} m" for p in plotted)
    yield ReportFigure(
        name=f"distribution_{name}",
        title=f"How large are the errors against {words}?",
        caption="The share of pairs whose error is at most so large, for each axis and in 3-D. The further left, the "
        "better.",
        alt=f"Median errors in 3-D: {medians}.",
        draw=partial(draw_distributions, plotted=plotted),
        height_in=_height(4.6, len(plotted)),
        # panels in two columns, each with its label
        fitted=True,
    )
    yield ReportFigure(
        name=f"boxes_{name}",
        title=f"Bias and scatter against {words}",
        caption="Errors of each run: the box holds the middle half of the pairs, with the median in it; whiskers reach "
        "from 5 to 95 %. A box that is not about zero is a bias.",
        alt=f"Boxes for x, y and z. Root mean square errors in 3-D: {sizes}.",
        draw=partial(draw_boxes, plotted=plotted),
        height_in=2.4 + 0.6 * len(plotted),
        # a label below each panel
        fitted=True,
    )


def _rms(values: FloatArray) -> float:
    """Return the root mean square of the numbers among values."""
    return float(np.sqrt(np.nanmean(values**2)))


def _height(inches: float, entries: int) -> float:
    """Return a figure's height with room for its legend."""
    return inches + _LEGEND_ROW_IN * -(-entries // LEGEND_COLUMNS)
