"""What the report's figures share: palette, style, margins, tints of the phases, and a figure as SVG or PNG.

Matplotlib is imported when the first figure is drawn: it takes a quarter of a second.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.metrics import PhaseLike
from groundstation.evaluation.position_series import BoolArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette, distinguishable with any colour vision; markers and line styles also distinguish the series
EKF, TRIANGULATION, DGPS, TRUTH, BOUND, SMOOTHED = "#0072B2", "#E69F00", "#009E73", "#000000", "#CC79A7", "#D55E00"
PHASE_COLOURS = {"sky": "#56B4E9", "mixed": "#F0E442", "ground": "#8C6D46"}
_PHASE_ALPHA = 0.13
# narrow, so that the text is still readable where a phone shows the figure 360 px wide
_WIDTH_IN = 4.7
_PNG_DPI = 150
MAX_POINTS = 1000
_BLACK_STROKE, _WHITE_GROUND = "stroke: #000000", '"fill: #ffffff"'
REPORT_CSS = """
:root{color-scheme:light dark}.pictures svg text{fill:currentColor}
@media screen and (prefers-color-scheme:dark){:root{--ink:#e6e9ec;--soft:#a3acb5;--line:#3a424a;--panel:#20262c;
--accent:#3fa0de}body{background:#14181c}}
"""
_STYLE: dict[Any, Any] = {
    # would merge the two ends of a dot, and lines have few points
    "path.simplify": False,
    "svg.fonttype": "none",
    "font.family": ["sans-serif"],
    "font.size": 10.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#808080",
    "grid.alpha": 0.27,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
}
# margins in inches, for labels of the style's size: of tick labels and an axis's name, and between panels
_LEFT_IN, _RIGHT_IN, _BOTTOM_IN, _TOP_IN, _GAP_IN = 0.74, 0.1, 0.48, 0.12, 0.16
_LEGEND_ROW_IN, _NAME_IN = 0.2, 0.14
_MOST_TICKS = 5
# of the axis: length of the stroke that is a dot, a hundredth of a pixel, since without a length none is drawn
_DOT = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportFigure:
    """One figure of the report.

    Attributes
    ----------
    name : of its files, without ending.
    title : above it.
    caption : text below it.
    alt : what it shows, for those who do not see it.
    draw : fills an empty figure; its panels are below each other.
    height_in : of the figure, in inches.
    fitted : lay it out by the size of its labels, which takes longer than drawing it; otherwise margins are fixed.
    """

    name: str
    title: str
    caption: str
    alt: str
    draw: Callable[["Figure"], None]
    height_in: float
    fitted: bool = False

    def drawn(self) -> "RenderedFigure":
        """Draw it, once for both kinds of file; the same each time."""
        import matplotlib as mpl
        from matplotlib.figure import Figure

        # names of clips and markers follow from the salt, and have to differ within a page
        with mpl.rc_context({**_STYLE, "svg.hashsalt": self.name}):
            figure = Figure(figsize=(_WIDTH_IN, self.height_in), layout="constrained" if self.fitted else None)
            self.draw(figure)
            if not self.fitted:
                lay_out(figure)
            svg, png = render(figure)
        label = escape(f"{self.title}. {self.alt}", quote=True)
        element = svg[svg.index("<svg") :].replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
        # on the page's own background and in the colour of its text, light or dark
        shown = element.replace(_BLACK_STROKE, "stroke: currentColor").replace(_WHITE_GROUND, '"fill: none"')
        file = f"<?xml version='1.0' encoding='utf-8'?>\n{element}"
        return RenderedFigure(picture=self, svg=shown, svg_file=file, png=png)


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderedFigure:
    """A figure as an SVG element of a page with a description, as an SVG file, and as a PNG file."""

    picture: ReportFigure
    svg: str
    svg_file: str
    png: bytes


def render(figure: "Figure") -> tuple[str, bytes]:
    """Return a figure as SVG and as PNG, the same bytes each time."""
    from groundstation.evaluation.pair_renderer import draw_pair

    return draw_pair(figure, _PNG_DPI)


def lay_out(figure: "Figure") -> None:
    """Place the panels of a figure below each other, between margins for labels and for the legend above them.

    Labels are of a known size, so nothing is measured; Matplotlib's layout engines draw the figure for that.
    """
    from matplotlib.ticker import AutoLocator
    from matplotlib.transforms import blended_transform_factory

    width_in, height_in = figure.get_size_inches()
    panels = figure.axes
    titled = any(ax.get_title(loc="right") for ax in panels)
    reserved_in = height_in * (1.0 - figure.subplotpars.top) if figure.legends or panels[0].get_legend() else 0.0
    top_in = _TOP_IN + reserved_in + titled * _NAME_IN
    gap_in = _GAP_IN + titled * _NAME_IN
    panel_in = (height_in - top_in - _BOTTOM_IN - (len(panels) - 1) * gap_in) / len(panels)
    figure.subplots_adjust(
        left=_LEFT_IN / width_in,
        right=1.0 - _RIGHT_IN / width_in,
        bottom=_BOTTOM_IN / height_in,
        top=1.0 - top_in / height_in,
        hspace=gap_in / panel_in,
    )
    for ax in panels:
        for axis in (ax.xaxis, ax.yaxis):
            locator = axis.get_major_locator()
            if isinstance(locator, AutoLocator):
                locator.set_params(nbins=_MOST_TICKS)
        sideways = blended_transform_factory(figure.dpi_scale_trans, ax.transAxes)
        ax.yaxis.set_label_coords(0.2, 0.5, transform=sideways)
    below = blended_transform_factory(panels[-1].transAxes, figure.dpi_scale_trans)
    panels[-1].xaxis.set_label_coords(0.5, 0.2, transform=below)


def stride(n: int) -> int:
    """Return the step that leaves at most `MAX_POINTS` of ``n``."""
    return max(1, -(-n // MAX_POINTS))


def gapped(values: FloatArray, known: BoolArray) -> FloatArray:
    """Return values with NaN where unknown, so that the line is not drawn across."""
    return np.where(known, values, np.nan)


def draw_dots(
    ax: "Axes", x: FloatArray, y: FloatArray, size: float, colour: str, alpha: float, label: str = ""
) -> None:
    """Draw round dots of ``size`` points at (n,) places, as one stroke with round caps: a marker is an element each."""
    known = np.isfinite(x) & np.isfinite(y)
    at, gap = x[known], np.full(np.count_nonzero(known), np.nan)
    length = _DOT * (float(np.ptp(at)) or 1.0) if len(at) else 0.0
    across = np.stack([at, at + length, gap], axis=1).ravel()
    up = np.stack([y[known], y[known], gap], axis=1).ravel()
    ax.plot(across, up, "-", lw=size, color=colour, alpha=alpha, solid_capstyle="round", snap=False)
    if label:
        ax.plot([], [], ".", ms=2 * size, color=colour, alpha=alpha, label=label)


def legend_above(ax: "Axes", columns: int) -> None:
    """Put the legend above the axes, where it hides nothing."""
    legend = ax.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, columnspacing=1.0, handletextpad=0.4, markerscale=2
    )
    reserve_rows(ax.get_figure(root=True), -(-len(legend.get_texts()) // columns))


def reserve_rows(figure: "Figure | None", rows: int) -> None:
    """Keep room for a legend of so many rows at the figure's top."""
    if figure is not None and figure.get_layout_engine() is None:
        figure.subplots_adjust(top=1.0 - rows * _LEGEND_ROW_IN / figure.get_size_inches()[1])


def shade_phases(ax: "Axes", phases: Sequence[PhaseLike], label: bool) -> None:
    """Tint the background of each phase; each kind enters the legend once."""
    seen: set[str] = set()
    for phase in phases:
        name = phase.background if label and phase.background not in seen else None
        seen.add(phase.background)
        shade = PHASE_COLOURS.get(phase.background, "#999999")
        ax.axvspan(phase.from_s, phase.to_s, color=shade, alpha=_PHASE_ALPHA, lw=0, label=name)
