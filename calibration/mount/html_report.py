"""report.html of a mount: one self-contained page with the residuals drawn."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from calibration.mount.calibrate import StationMount
from calibration.mount.text_report import format_mount, verdict
from calibration.report.drawing import BLUE, GREEN, ORANGE, png_of
from calibration.report.head_page import PagePart, station_heading, write_head_page
from calibration.report.picture import ReportPicture


def write_mount_page(folder: Path, found: Sequence[StationMount]) -> list[Path]:
    """Write report.html and its pictures as PNG into ``folder``, created if missing; returns the written files."""
    parts = [
        PagePart(
            heading=station_heading(one.before.name),
            verdict=verdict(one),
            pictures=_pictures(one),
            text=format_mount(one),
        )
        for one in found
    ]
    return write_head_page(folder, "camera on its head", "Mount", parts)


def _pictures(one: StationMount) -> list[ReportPicture]:
    name = one.before.name
    return [
        ReportPicture(
            name=f"{name}-residuals",
            title="What is left over",
            caption="Each dot is a sighting: how far it was from where the result puts it. Orange: left out.",
            png=png_of(_draw_residuals, one),
        ),
        ReportPicture(
            name=f"{name}-coverage",
            title="Where marks were seen",
            caption="At which angles marks were seen, what is left over drawn 300 times too large.",
            png=png_of(_draw_coverage, one),
        ),
        ReportPicture(
            name=f"{name}-over-angle",
            title="Left over against angle",
            caption="What is left over against the reading. A slope or a bow is an error that the model does not have.",
            png=png_of(_draw_over_angle, one),
        ),
    ]


def _draw_residuals(figure: Figure, one: StationMount) -> None:
    residual, kept = one.fit.residual_px, one.fit.kept
    axes = figure.subplots()
    axes.plot(*residual[kept].T, ".", color=BLUE, ms=4)
    limit = 1.2 * float(np.abs(residual[kept]).max(initial=0.1))
    axes.plot(*np.clip(residual[~kept], -limit, limit).T, "x", color=ORANGE)
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), xlabel="u left over, px", ylabel="v left over, px")
    axes.set_aspect("equal")


def _draw_coverage(figure: Figure, one: StationMount) -> None:
    fit, kept = one.fit, one.fit.kept
    degrees = np.degrees(fit.problem.sightings.reading_rad)
    axes = figure.subplots()
    drawn = np.degrees(fit.residual_px[kept] / one.after.lens.focal_px) * (1, -1)
    axes.plot(*degrees[kept].T, ".", color=BLUE, ms=3)
    axes.quiver(*degrees[kept].T, *drawn.T, angles="xy", scale_units="xy", scale=1.0 / 300.0, width=0.002, color=GREEN)
    axes.plot(*degrees[~kept].T, "x", color=ORANGE)
    axes.set(xlabel="pan, deg", ylabel="tilt, deg")


def _draw_over_angle(figure: Figure, one: StationMount) -> None:
    residual, kept = one.fit.residual_px, one.fit.kept
    degrees = np.degrees(one.fit.problem.sightings.reading_rad)
    for row, (axis, word) in enumerate((("pan", "u"), ("tilt", "v"))):
        plot = figure.add_subplot(2, 1, row + 1)
        plot.axhline(0.0, color="0.7", lw=1)
        plot.plot(degrees[kept, row], residual[kept, row], ".", color=BLUE, ms=4)
        plot.set(xlabel=f"{axis}, deg", ylabel=f"{word} left over, px")
