"""Stanford diagram: how often which error at which protection level, one panel an axis."""

import io
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from groundstation.arrays import FloatArray
from integrity_approaches.counts import DIAGRAM_CELLS, DIAGRAM_LIMITS

_AXES = ("along the runway", "across", "up")
_STYLE: dict[Any, Any] = {
    "font.family": ["sans-serif"],
    "font.size": 12,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
_EDGED = [withStroke(linewidth=3.0, foreground="white")]
_WRONG, _LIMIT = "#D55E00", "#444444"


def draw_stanford(counts: FloatArray) -> bytes:
    """Return the PNG of counts (3, levels, errors), both in alert limits."""
    edges = np.linspace(0.0, DIAGRAM_LIMITS, DIAGRAM_CELLS + 1)
    with rc_context(_STYLE):
        figure = Figure(figsize=(11.0, 4.4), layout="constrained")
        panels = figure.subplots(1, 3, sharex=True, sharey=True)
        mesh = None
        for axis, ax in enumerate(panels):
            shown = np.ma.masked_less(counts[axis], 0.5)
            mesh = ax.pcolormesh(edges, edges, shown, norm=LogNorm(1.0, counts.max()), cmap="cividis")
            ax.plot([0.0, DIAGRAM_LIMITS], [0.0, DIAGRAM_LIMITS], color=_WRONG, lw=1.6)
            ax.axhline(1.0, color=_LIMIT, lw=1.2, ls="--")
            ax.axvline(1.0, color=_LIMIT, lw=1.2, ls="--")
            ax.set_title(_AXES[axis], fontsize=12, loc="left")
            ax.set_xlabel("error over alert limit")
            ax.set_aspect("equal")
            ax.text(1.3, 0.45, "misleading", color=_WRONG, ha="center")
            ax.text(0.5, 1.38, "not available", color="black", ha="center", path_effects=_EDGED)
        panels[0].set_ylabel("protection level over alert limit")
        if mesh is not None:
            figure.colorbar(mesh, ax=panels, aspect=30, pad=0.01).set_label("pairs of pictures")
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=130, metadata={"Software": None})
    return buffer.getvalue()
