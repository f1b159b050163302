"""report.html of a mount: one self-contained page with the residuals drawn."""

import io
from collections.abc import Sequence
from html import escape
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from calibration.mount.calibrate import StationMount
from calibration.mount.text_report import format_mount, verdict
from groundstation.files.html_page import (
    bullet_list,
    html_page,
    page_header,
    picture_grid,
    png_figure,
    preformatted,
    verdict_line,
)
from groundstation.files.output_names import below
from groundstation.files.whole_file import write_whole

_BLUE, _ORANGE, _GREEN = "#0072B2", "#D55E00", "#009E73"
_TITLES = {
    "residuals": "What is left over",
    "coverage": "Where marks were seen",
    "over-angle": "Left over against angle",
}
_CAPTIONS = {
    "residuals": "Each dot is a sighting: how far it was from where the result puts it. Orange: left out.",
    "coverage": "At which angles marks were seen, what is left over drawn 300 times too large.",
    "over-angle": "What is left over against the reading. A slope or a bow is an error that the model does not have.",
}


def write_mount_page(folder: Path, found: Sequence[StationMount]) -> list[Path]:
    """Write report.html and its pictures as PNG into ``folder``, created if missing; returns the written files."""
    folder.mkdir(parents=True, exist_ok=True)
    written, parts = [folder / "report.html"], []
    for one in found:
        name = one.before.name
        parts.append(f"<h2>Station {escape(name)}</h2>" + verdict_line(verdict(one)[0]))
        parts.append(bullet_list(verdict(one)[1:]))
        figures = []
        for kind, png in _pictures(one).items():
            written.append(below(folder, f"{name}-{kind}.png"))
            write_whole(written[-1], png)
            figures.append(png_figure(_TITLES[kind], _CAPTIONS[kind], png))
        parts += [picture_grid(figures), preformatted(format_mount(one))]
    body = page_header("camera on its head", "Mount") + "\n".join(parts)
    write_whole(written[0], html_page("Mount", body))
    return written


def _pictures(one: StationMount) -> dict[str, bytes]:
    fit, seen = one.fit, one.fit.problem.sightings
    residual, kept = fit.residual_px, fit.kept
    degrees = np.degrees(seen.reading_rad)
    with mpl.rc_context({"font.size": 12, "axes.spines.top": False, "axes.spines.right": False}):
        dots = Figure(figsize=(6.4, 5.4), layout="constrained")
        axes = dots.subplots()
        axes.plot(*residual[kept].T, ".", color=_BLUE, ms=4)
        limit = 1.2 * float(np.abs(residual[kept]).max(initial=0.1))
        shown = np.clip(residual[~kept], -limit, limit)
        axes.plot(*shown.T, "x", color=_ORANGE)
        axes.set(xlim=(-limit, limit), ylim=(-limit, limit), xlabel="u left over, px", ylabel="v left over, px")
        axes.set_aspect("equal")

        where = Figure(figsize=(6.4, 5.4), layout="constrained")
        axes = where.subplots()
        focal = one.after.lens.focal_px
        drawn = np.degrees(residual[kept] / focal) * (1, -1)
        axes.plot(*degrees[kept].T, ".", color=_BLUE, ms=3)
        axes.quiver(
            *degrees[kept].T, *drawn.T, angles="xy", scale_units="xy", scale=1.0 / 300.0, width=0.002, color=_GREEN
        )
        axes.plot(*degrees[~kept].T, "x", color=_ORANGE)
        axes.set(xlabel="pan, deg", ylabel="tilt, deg")

        over = Figure(figsize=(6.4, 5.4), layout="constrained")
        for row, (axis, word) in enumerate((("pan", "u"), ("tilt", "v"))):
            plot = over.add_subplot(2, 1, row + 1)
            plot.axhline(0.0, color="0.7", lw=1)
            plot.plot(degrees[kept, row], residual[kept, row], ".", color=_BLUE, ms=4)
            plot.set(xlabel=f"{axis}, deg", ylabel=f"{word} left over, px")
    return {"residuals": _png(dots), "coverage": _png(where), "over-angle": _png(over)}


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return buffer.getvalue()
