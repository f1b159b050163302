"""Drawings of the reports of a calibration, as the bytes of a PNG file."""

import io
from collections.abc import Callable
from typing import Any, TypeVarTuple

import matplotlib as mpl
from matplotlib.figure import Figure

SIZE_IN = (6.4, 5.4)
BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
PLAIN: dict[Any, Any] = {"font.size": 12, "axes.spines.top": False, "axes.spines.right": False}
# with a title in the figure
TITLED: dict[Any, Any] = {
    **PLAIN,
    "font.family": ["sans-serif"],
    "font.size": 13,
    "axes.titlesize": 13,
    "axes.titlelocation": "left",
}
_DPI = 150

Content = TypeVarTuple("Content")


def png_of(
    draw: Callable[[Figure, *Content], object],
    *content: *Content,
    style: dict[Any, Any] = PLAIN,
    size_in: tuple[float, float] = SIZE_IN,
    dpi: int = _DPI,
) -> bytes:
    """Return what ``draw`` makes of a figure and the content; needs no window system."""
    with mpl.rc_context(style):
        figure = Figure(figsize=size_in, layout="constrained")
        draw(figure, *content)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()
