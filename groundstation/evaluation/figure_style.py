"""What the report's figures share: palette, style, tints of the phases, and a figure as SVG or PNG."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from groundstation.arrays import FloatArray
from groundstation.evaluation.metrics import PhaseLike
from groundstation.evaluation.position_series import BoolArray

# Okabe and Ito's palette, distinguishable with any colour vision; markers and line styles also distinguish the series
EKF, TRIANGULATION, DGPS, TRUTH, BOUND, SMOOTHED = "#0072B2", "#E69F00", "#009E73", "#000000", "#CC79A7", "#D55E00"
_PHASE_SHADES = {"sky": "#56B4E9", "mixed": "#F0E442", "ground": "#8C6D46"}
_PHASE_ALPHA = 0.13
# narrow, so that the text is still readable where a phone shows the figure 360 px wide
_WIDTH_IN = 4.7
_PNG_DPI = 200
MAX_POINTS = 1000
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "groundstation",
    "font.family": ["sans-serif"],
    "font.size": 10.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportFigure:
    """One figure of the report.

    Attributes
    ----------
    name : of its files, without ending.
    title : above it.
    caption : text below it.
    alt : what it shows, for those who do not see it.
    draw : fills an empty figure.
    height_in : of the figure, in inches.
    """

    name: str
    title: str
    caption: str
    alt: str
    draw: Callable[[Figure], None]
    height_in: float

    def drawn(self) -> "RenderedFigure":
        """Draw it, once for both kinds of file; the same each time."""
        with mpl.rc_context(_STYLE):
            figure = Figure(figsize=(_WIDTH_IN, self.height_in), layout="constrained")
            self.draw(figure)
            svg, png = render(figure)
            # frees most of its memory now instead of at the next garbage collection
            figure.clear()
        label = escape(f"{self.title}. {self.alt}", quote=True)
        element = svg[svg.index("<svg") :].replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
        return RenderedFigure(picture=self, svg=element, png=png)


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderedFigure:
    """A figure as an SVG element with a description, and as a PNG file."""

    picture: ReportFigure
    svg: str
    png: bytes


def render(figure: Figure) -> tuple[str, bytes]:
    """Return a figure as SVG and as PNG, the same bytes each time.

    `Figure.savefig` would draw the figure once more for each format, to lay out what is laid out already.
    """
    text, pixels = io.StringIO(), io.BytesIO()
    # the layout takes longer than drawing, and is the same for both
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": None})
    figure.set_dpi(_PNG_DPI)
    FigureCanvasAgg(figure).print_png(pixels, metadata={"Software": None})
    return text.getvalue(), pixels.getvalue()


def stride(n: int) -> int:
    """Return the step that leaves at most `MAX_POINTS` of ``n``."""
    return max(1, -(-n // MAX_POINTS))


def gapped(values: FloatArray, known: BoolArray) -> FloatArray:
    """Return values with NaN where unknown, so that the line is not drawn across."""
    return np.where(known, values, np.nan)


def legend_above(ax: Axes, columns: int) -> None:
    """Put the legend above the axes, where it hides nothing."""
    ax.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, columnspacing=1.0, handletextpad=0.4, markerscale=2
    )


def shade_phases(ax: Axes, phases: Sequence[PhaseLike], label: bool) -> None:
    """Tint the background of each phase; each kind enters the legend once."""
    seen: set[str] = set()
    for phase in phases:
        name = phase.background if label and phase.background not in seen else None
        seen.add(phase.background)
        shade = _PHASE_SHADES.get(phase.background, "#999999")
        ax.axvspan(phase.from_s, phase.to_s, color=shade, alpha=_PHASE_ALPHA, lw=0, label=name)
