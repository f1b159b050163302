"""report.html of a calibration by stars: residuals over the picture and over the head's range, drawn."""

import io
from html import escape
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from calibration.stars.calibrate import NightCalibration
from calibration.stars.text_report import format_night, verdict
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
    "lens": "Over the picture",
    "head": "Over the head's range",
    "over-angle": "Readings against angle",
}
_CAPTIONS = {
    "lens": "Each arrow is a star: how far it was from where its picture's other stars put it. A pattern is an error of"
    " the lens that the model does not have.",
    "head": "Each dot is a picture; the arrow is what its stars have in common, the error of its two readings.",
    "over-angle": "What a picture's stars have in common against the reading. A slope or a bow is an error of the axes"
    " that the model does not have.",
}


def write_night_page(folder: Path, found: NightCalibration) -> list[Path]:
    """Write report.html and its pictures as PNG into ``folder``, created if missing; returns the written files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "report.html"]
    parts = [verdict_line(verdict(found)[0]), bullet_list(verdict(found)[1:])]
    for k, night in enumerate(found.joint.nights):
        name = night.before.name
        figures = []
        for kind, png in _pictures(found, k).items():
            written.append(below(folder, f"{name}-{kind}.png"))
            write_whole(written[-1], png)
            figures.append(png_figure(_TITLES[kind], _CAPTIONS[kind], png))
        parts += [f"<h2>Station {escape(name)}</h2>", picture_grid(figures)]
    parts.append(preformatted(format_night(found)))
    body = page_header("heads by the stars", "Stars") + "\n".join(parts)
    write_whole(written[0], html_page("Stars", body))
    return written


def _pictures(found: NightCalibration, k: int) -> dict[str, bytes]:
    fit = found.joint.nights[k].fit
    seen, kept = fit.problem.sightings, fit.kept
    numbers = [n for n in np.unique(seen.pointing) if np.any(kept & (seen.pointing == n))]
    common = np.array([fit.residual_px[kept & (seen.pointing == n)].mean(axis=0) for n in numbers])
    reading = np.degrees([seen.reading_rad[seen.pointing == n][0] for n in numbers])
    place = {n: row for row, n in enumerate(numbers)}
    own = fit.residual_px[kept] - common[[place[n] for n in seen.pointing[kept]]]
    turned = np.degrees(common / fit.problem.station.lens.focal_px) * (-1, 1)
    w, h = fit.problem.station.lens.image_size_px
    with mpl.rc_context({"font.size": 12, "axes.spines.top": False, "axes.spines.right": False}):
        lens = Figure(figsize=(6.4, 5.4), layout="constrained")
        axes = lens.subplots()
        arrows = axes.quiver(*seen.pixel_px[kept].T, *own.T, angles="xy", scale_units="xy", scale=1 / 200, color=_GREEN)
        axes.quiverkey(arrows, 0.85, 1.03, 0.25, "0.25 px", labelpos="E")
        axes.set(xlim=(0, w), ylim=(h, 0), xlabel="u, px", ylabel="v, px", aspect="equal")

        head = Figure(figsize=(6.4, 5.4), layout="constrained")
        axes = head.subplots()
        axes.plot(*reading.T, ".", color=_BLUE, ms=5)
        arrows = axes.quiver(
            *reading.T, *turned.T, angles="xy", scale_units="xy", scale=1 / 2000, width=0.004, color=_ORANGE
        )
        axes.set_title(" ")
        axes.quiverkey(arrows, 0.8, 1.04, 0.005, "0.005 deg", labelpos="E")
        axes.set(xlabel="pan, deg", ylabel="tilt, deg")
        axes.margins(0.15)

        over = Figure(figsize=(6.4, 5.4), layout="constrained")
        for axis, word in enumerate(("pan", "tilt")):
            plot = over.add_subplot(2, 1, axis + 1)
            plot.axhline(0.0, color="0.7", lw=1)
            plot.plot(reading[:, axis], turned[:, axis], ".", color=_BLUE, ms=6)
            plot.set(xlabel=f"{word}, deg", ylabel=f"{word} left over, deg")
    return {"lens": _png(lens), "head": _png(head), "over-angle": _png(over)}


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return buffer.getvalue()
