"""report.html of a calibration by stars: residuals over the picture and over the head's range, drawn."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from calibration.mount.fit import MountFit
from calibration.report.drawing import BLUE, GREEN, ORANGE, png_of
from calibration.report.head_page import PagePart, station_heading, write_head_page
from calibration.report.picture import ReportPicture
from calibration.stars.calibrate import NightCalibration
from calibration.stars.text_report import format_night, verdict
from groundstation.arrays import FloatArray


def write_night_page(folder: Path, found: NightCalibration) -> list[Path]:
    """Write report.html and its pictures as PNG into ``folder``, created if missing; returns the written files."""
    stations = [
        PagePart(heading=station_heading(night.before.name), pictures=_pictures(night.before.name, night.fit))
        for night in found.joint.nights
    ]
    parts = [*stations, PagePart(heading="In words", text=format_night(found))]
    return write_head_page(folder, "heads by the stars", "Stars", parts, verdict(found))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LeftOver:
    """What n pictures' stars have in common, and what each of m stars has of its own.

    Attributes
    ----------
    reading_deg : (n, 2) of each picture. turned_deg : (n, 2) its common residual as pan and tilt.
    pixel_px, own_px : (m, 2) places of the stars and their residuals without the common one.
    """

    reading_deg: FloatArray
    turned_deg: FloatArray
    pixel_px: FloatArray
    own_px: FloatArray


def _left_over(fit: MountFit) -> _LeftOver:
    seen, kept = fit.problem.sightings, fit.kept
    numbers = [n for n in np.unique(seen.pointing) if np.any(kept & (seen.pointing == n))]
    common = np.array([fit.residual_px[kept & (seen.pointing == n)].mean(axis=0) for n in numbers])
    place = {n: row for row, n in enumerate(numbers)}
    return _LeftOver(
        reading_deg=np.degrees([seen.reading_rad[seen.pointing == n][0] for n in numbers]),
        turned_deg=np.degrees(common / fit.problem.station.lens.focal_px) * (-1, 1),
        pixel_px=seen.pixel_px[kept],
        own_px=fit.residual_px[kept] - common[[place[n] for n in seen.pointing[kept]]],
    )


def _pictures(name: str, fit: MountFit) -> list[ReportPicture]:
    left, size_px = _left_over(fit), fit.problem.station.lens.image_size_px
    return [
        ReportPicture(
            name=f"{name}-lens",
            title="Over the picture",
            caption="Each arrow is a star: how far it was from where its picture's other stars put it. A pattern is an"
            " error of the lens that the model does not have.",
            png=png_of(_draw_lens, left, size_px),
        ),
        ReportPicture(
            name=f"{name}-head",
            title="Over the head's range",
            caption="Each dot is a picture; the arrow is what its stars have in common, the error of its two readings.",
            png=png_of(_draw_head, left),
        ),
        ReportPicture(
            name=f"{name}-over-angle",
            title="Readings against angle",
            caption="What a picture's stars have in common against the reading. A slope or a bow is an error of the"
            " axes that the model does not have.",
            png=png_of(_draw_over_angle, left),
        ),
    ]


def _draw_lens(figure: Figure, left: _LeftOver, size_px: tuple[int, int]) -> None:
    axes = figure.subplots()
    arrows = axes.quiver(*left.pixel_px.T, *left.own_px.T, angles="xy", scale_units="xy", scale=1 / 200, color=GREEN)
    axes.quiverkey(arrows, 0.85, 1.03, 0.25, "0.25 px", labelpos="E")
    w, h = size_px
    axes.set(xlim=(0, w), ylim=(h, 0), xlabel="u, px", ylabel="v, px", aspect="equal")


def _draw_head(figure: Figure, left: _LeftOver) -> None:
    axes = figure.subplots()
    axes.plot(*left.reading_deg.T, ".", color=BLUE, ms=5)
    arrows = axes.quiver(
        *left.reading_deg.T,
        *left.turned_deg.T,
        angles="xy",
        scale_units="xy",
        scale=1 / 2000,
        width=0.004,
        color=ORANGE,
    )
    axes.set_title(" ")
    axes.quiverkey(arrows, 0.8, 1.04, 0.005, "0.005 deg", labelpos="E")
    axes.set(xlabel="pan, deg", ylabel="tilt, deg")
    axes.margins(0.15)


def _draw_over_angle(figure: Figure, left: _LeftOver) -> None:
    for axis, word in enumerate(("pan", "tilt")):
        plot = figure.add_subplot(2, 1, axis + 1)
        plot.axhline(0.0, color="0.7", lw=1)
        plot.plot(left.reading_deg[:, axis], left.turned_deg[:, axis], ".", color=BLUE, ms=6)
        plot.set(xlabel=f"{word}, deg", ylabel=f"{word} left over, deg")
