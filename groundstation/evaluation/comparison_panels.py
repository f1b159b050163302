"""What the pictures of a comparison show: each function fills one empty figure with the lines of all runs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from groundstation.arrays import FloatArray
from groundstation.evaluation.figure_style import TRUTH, gapped, stride
from groundstation.evaluation.run_series import POSITION_DOF, ErrorSeries, RunSeries
from groundstation.geometry.chi_square import chi_square_quantile

AXES = ("x", "y", "z", "3-D")
# bands of more runs than these hide each other: their edges only
MOST_BANDS = 4
LEGEND_COLUMNS = 2
NEES_WINDOW_S = 2.0
# Okabe and Ito's palette without yellow, which is too light for a line; then the same colours with other line styles
RUN_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_LINE_STYLES = ("-", "--", "-.", ":")
# steps of range: at most so many, and on average at least so many pairs of each run in one that it covers
_MOST_STEPS, _PAIRS_A_STEP = 16, 6
_LEAST_IN_STEP = 3
# labels of a logarithmic axis in each decade, and how many it has at least
_STEPS = (1.0, 2.0, 5.0)
_LEAST_LABELS, _WIDER = 2, 1.1
_NEES_LIMITS = (0.02, 50.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlottedErrors:
    """One run's errors with its colour and line style; ``shift_s`` is what its times are reduced by."""

    name: str
    errors: ErrorSeries
    colour: str
    style: str
    shift_s: float

    @property
    def t_s(self) -> FloatArray:
        """Return the times (n,) on the common axis."""
        return self.errors.t_s - self.shift_s

    @property
    def marker(self) -> str:
        """Return what a line of one pair needs, to be seen."""
        return _marker(int(np.count_nonzero(self.errors.known)))


def run_styles(count: int) -> list[tuple[str, str]]:
    """Return a colour and a line style for each of so many runs; the same again after 28."""
    colours, styles = len(RUN_COLOURS), len(_LINE_STYLES)
    return [(RUN_COLOURS[k % colours], _LINE_STYLES[k // colours % styles]) for k in range(count)]


def draw_tracks(figure: Figure, runs: Sequence[RunSeries], axis: int) -> None:
    """Draw one coordinate over y."""
    ax = figure.subplots()
    label: str | None = "reference"
    for run in runs:
        for reference in run.references.values():
            place = reference.position_m[:: stride(len(run.track))]
            ax.plot(place[:, 1], place[:, axis], color=TRUTH, lw=2.6, alpha=0.25, label=label)
            label = None
    for run, (colour, style) in zip(runs, run_styles(len(runs)), strict=True):
        count = int(np.count_nonzero(run.track.known))
        if not count:
            continue
        place = run.track.position_m[:: stride(len(run.track))]
        ax.plot(place[:, 1], place[:, axis], color=colour, ls=style, marker=_marker(count), label=_label(run.name))
    shown = np.concatenate([run.track.position_m[run.track.known, axis] for run in runs])
    low, high = np.percentile(shown, [0.5, 99.5])
    room = max(0.15 * (high - low), 0.2)
    ax.set_ylim(low - room, high + room)
    ax.set_xlabel("y in m")
    ax.set_ylabel(f"{AXES[axis]} in m")
    _legend(figure, ax)


def draw_errors(figure: Figure, plotted: Sequence[PlottedErrors], clock: str) -> None:
    """Draw x, y, z and the size of the error over time."""
    panels = figure.subplots(4, 1, sharex=True)
    for axis, ax in enumerate(panels[:3]):
        reach = [0.01]
        for p in plotted:
            step = stride(len(p.t_s))
            t, error = p.t_s[::step], p.errors.error_m[::step, axis]
            band = np.where(p.errors.known[::step], 2.0 * p.errors.sigma_m[::step, axis], np.nan)
            if len(plotted) <= MOST_BANDS:
                ax.fill_between(t, -band, band, color=p.colour, alpha=0.12, lw=0)
            else:
                ax.plot(np.r_[t, np.nan, t], np.r_[-band, np.nan, band], color=p.colour, lw=0.5, alpha=0.6)
            line = gapped(error, p.errors.known[::step])
            ax.plot(t, line, color=p.colour, ls=p.style, marker=p.marker, label=_label(p.name))
            reach.append(float(np.nanpercentile(np.abs(error), 99)) if np.isfinite(error).any() else 0.0)
            reach.append(float(np.nanpercentile(band, 90)) if np.isfinite(band).any() else 0.0)
        ax.set_ylim(-1.25 * max(reach), 1.25 * max(reach))
        ax.set_ylabel(f"{AXES[axis]} in m")
    for p in plotted:
        step = stride(len(p.t_s))
        stated = np.sqrt((p.errors.sigma_m[::step] ** 2).sum(axis=1))
        known = p.errors.known[::step]
        panels[3].plot(p.t_s[::step], gapped(stated, known), color=p.colour, lw=0.6)
        size = gapped(p.errors.distance_m[::step], known)
        panels[3].plot(p.t_s[::step], size, color=p.colour, ls=p.style, marker=p.marker)
    _logarithmic(panels[3], [p.errors.distance_m for p in plotted])
    panels[3].set_ylabel("3-D in m")
    panels[3].set_xlabel(clock)
    _legend(figure, panels[0])


def draw_distributions(figure: Figure, plotted: Sequence[PlottedErrors]) -> None:
    """Draw the cumulative distribution of the errors' sizes, one panel per axis and one for 3-D."""
    panels = figure.subplots(2, 2, sharey=True)
    for axis, ax in enumerate(panels.flat):
        for p in plotted:
            size = np.sort(_size(p.errors, axis))
            share = 100.0 * np.arange(1, len(size) + 1) / len(size)
            step = stride(len(size))
            ax.plot(size[::step], share[::step], color=p.colour, ls=p.style, marker=p.marker, label=_label(p.name))
        ax.set_xscale("log")
        sizes = np.concatenate([_size(p.errors, axis) for p in plotted])
        positive = sizes[sizes > 0.0]
        if len(positive):
            low, high = float(np.percentile(positive, 2)), 1.2 * float(positive.max())
            # labels of three steps to the decade have room in less than two decades
            steps = (1.0, 3.0) if high < 60.0 * low else (1.0,)
            ax.set_xlim(_with_labels(low, high, steps))
            _plain_logarithms(ax.xaxis, steps)
        ax.axhline(95.0, color="#888888", lw=0.8, ls=":")
        ax.set_xlabel(f"{AXES[axis]} in m")
    for ax in panels[:, 0]:
        ax.set_ylabel("% of pairs")
    _legend(figure, panels[0, 0])


def draw_boxes(figure: Figure, plotted: Sequence[PlottedErrors]) -> None:
    """Draw boxes of the signed errors, one panel per axis."""
    panels = figure.subplots(3, 1)
    for axis, ax in enumerate(panels):
        rows = [p.errors.error_m[p.errors.known, axis] for p in plotted]
        boxes = ax.boxplot(
            rows[::-1],
            orientation="horizontal",
            whis=(5, 95),
            showfliers=False,
            widths=0.6,
            patch_artist=True,
            medianprops={"color": "#000000", "lw": 1.2},
        )
        for box, p in zip(boxes["boxes"], plotted[::-1], strict=True):
            box.set(facecolor=p.colour, alpha=0.55)
        ax.set_yticklabels([_label(p.name) for p in plotted[::-1]])
        ax.axvline(0.0, color="#444444", lw=0.8)
        ax.set_xlabel(f"{AXES[axis]} in m")


def draw_range(figure: Figure, plotted: Sequence[PlottedErrors]) -> None:
    """Draw root mean square errors and stated sigmas over range, logarithmic."""
    panels = figure.subplots(4, 1, sharex=True)
    edges = _range_edges(plotted)
    for axis, ax in enumerate(panels):
        drawn = []
        for p in plotted:
            at, error, stated = _by_range(p.errors, axis, edges)
            # the dashes keep a run visible that has one step only
            ax.plot(at, stated, color=p.colour, lw=0.7, marker="_", ms=6)
            ax.plot(at, error, color=p.colour, ls=p.style, marker="o", ms=3.5, label=_label(p.name))
            drawn += [error, stated]
        _logarithmic(ax, drawn)
        ax.set_ylabel(f"{AXES[axis]} in m")
    panels[-1].set_xlabel("range y in m")
    _legend(figure, panels[0])


def draw_nees(figure: Figure, plotted: Sequence[PlottedErrors], clock: str) -> None:
    """Draw the running mean NEES per degree of freedom, logarithmic."""
    ax = figure.subplots()
    for number, p in enumerate(plotted):
        nees = p.errors.nees()
        known = np.isfinite(nees)
        t = p.t_s[known]
        low, high = np.searchsorted(t, t - NEES_WINDOW_S / 2), np.searchsorted(t, t + NEES_WINDOW_S / 2, side="right")
        total = np.concatenate([[0.0], np.cumsum(nees[known])])
        mean = (total[high] - total[low]) / np.maximum(high - low, 1)
        step = stride(len(t))
        if number == 0:
            freedom = POSITION_DOF * (high - low)[::step]
            band = chi_square_quantile(np.array([[0.025], [0.975]]), freedom) / freedom
            ax.fill_between(t[::step], band[0], band[1], color="#999999", alpha=0.3, lw=0, label="95 % band")
        line = np.full(len(p.t_s), np.nan)
        line[known] = mean
        step = stride(len(line))
        ax.plot(p.t_s[::step], np.clip(line, *_NEES_LIMITS)[::step], color=p.colour, ls=p.style, label=_label(p.name))
    ax.axhline(1.0, color="#444444", lw=0.8)
    ax.set_yscale("log")
    ax.set_ylim(*_NEES_LIMITS)
    _plain_logarithms(ax.yaxis, (1.0,))
    ax.set_xlabel(clock)
    ax.set_ylabel("NEES / freedom")
    _legend(figure, ax)


# ---------------------------------------------------------------------------------------------- parts
def _size(errors: ErrorSeries, axis: int) -> FloatArray:
    """Return the known errors' sizes along an axis, or in 3-D."""
    return errors.distance_m[errors.known] if axis == 3 else np.abs(errors.error_m[errors.known, axis])


def _range_edges(plotted: Sequence[PlottedErrors]) -> FloatArray:
    """Return equal steps over all runs' ranges."""
    spans = [p.errors.range_m[p.errors.known] for p in plotted]
    low, high = min(float(y.min()) for y in spans), max(float(y.max()) for y in spans)
    # wide enough for the run with the fewest pairs to the metre, not for the shortest run
    width_m = max(_PAIRS_A_STEP * float(np.ptp(y)) / len(y) for y in spans)
    steps = _MOST_STEPS if width_m * _MOST_STEPS <= high - low else max(int((high - low) / width_m), 1)
    return np.linspace(low, max(high, low + 1.0) + 1e-6, steps + 1)


def _by_range(errors: ErrorSeries, axis: int, edges: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the steps' middles, root mean square errors and stated sigmas; not a number where too few pairs are."""
    number = np.digitize(errors.range_m, edges) - 1
    squared = errors.distance_m**2 if axis == 3 else errors.error_m[:, axis] ** 2
    variance = (errors.sigma_m**2).sum(axis=1) if axis == 3 else errors.sigma_m[:, axis] ** 2
    found = np.full((2, len(edges) - 1), np.nan)
    for k in range(len(edges) - 1):
        inside = errors.known & (number == k)
        if np.count_nonzero(inside) >= _LEAST_IN_STEP:
            found[0, k] = np.sqrt(squared[inside].mean())
            found[1, k] = np.sqrt(variance[inside].mean())
    return 0.5 * (edges[1:] + edges[:-1]), found[0], found[1]


def _logarithmic(ax: Axes, series: Sequence[FloatArray]) -> None:
    """Make an axis of lengths logarithmic, from the smallest of each hundred values on."""
    ax.set_yscale("log")
    values = np.concatenate(series)
    positive = values[np.isfinite(values) & (values > 0.0)]
    if len(positive):
        low, high = 0.7 * float(np.percentile(positive, 1)), 1.5 * float(positive.max())
        ax.set_ylim(_with_labels(low, high, _STEPS))
    _plain_logarithms(ax.yaxis, _STEPS)


def _with_labels(low: float, high: float, steps: tuple[float, ...]) -> tuple[float, float]:
    """Return the limits of a logarithmic axis, widened until two of its labels lie between them.

    Errors of few pairs are nearly one number; with fewer labels Matplotlib chooses others, which run into each other.
    """
    decades = 10.0 ** np.arange(np.floor(np.log10(low)) - 1.0, np.ceil(np.log10(high)) + 2.0)
    labels = np.outer(decades, steps)
    while np.count_nonzero((labels >= low) & (labels <= high)) < _LEAST_LABELS:
        low, high = low / _WIDER, high * _WIDER
    return low, high


def _plain_logarithms(axis: Axis, steps: tuple[float, ...]) -> None:
    """Label a logarithmic axis at these steps of each decade, without exponents."""
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _marker(count: int) -> str:
    """Return the marker of a line of so many places: a single one is seen by it alone."""
    return "o" if count == 1 else ""


def _legend(figure: Figure, ax: Axes) -> None:
    """Put the runs' names above the figure, where they hide nothing."""
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=LEGEND_COLUMNS, columnspacing=1.2, handletextpad=0.5)


def _label(name: str) -> str:
    """Return a run's name as a label: one that begins with an underscore would be left out of the legend."""
    return f" {name}" if name.startswith("_") else name
