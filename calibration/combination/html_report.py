"""report.html of a combination: what each rig and all together know, and how each looks elsewhere than the result."""

from itertools import combinations
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from calibration.combination.directions import across_and_up, directions, readings_of
from calibration.combination.fusion import Combination
from calibration.combination.text_report import format_combination, relative_direction
from calibration.report.drawing import png_of
from calibration.report.head_page import PagePart, station_heading, write_head_page
from calibration.report.picture import ReportPicture
from groundstation.arrays import FloatArray
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.rig.rig import Rig, Station

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_TOGETHER = "#1b1f24"
_BAR = 0.38


def write_combination_page(folder: Path, found: Combination) -> list[Path]:
    """Write report.html and its pictures as PNG into ``folder``, created if missing; returns the written files."""
    pairs = [
        ReportPicture(
            name=f"{first}-{second}-sigma",
            title=f"{first} against {second}",
            caption="One sigma of their relative direction over the angles of operation, by each rig and together.",
            png=png_of(_draw_sigmas, found, first, second),
        )
        for first, second in combinations(found.rig.names, 2)
    ]
    stations = [
        PagePart(
            heading=station_heading(station.name),
            pictures=[
                ReportPicture(
                    name=f"{station.name}-directions",
                    title="Where each rig looks elsewhere",
                    caption="How far each rig's direction is from the result's, over the angles of operation, the"
                    " turn between true north and the frame taken out.",
                    png=png_of(_draw_directions, found, station),
                )
            ],
        )
        for station in found.rig.stations
    ]
    parts = [PagePart(heading="What is known", pictures=pairs), *stations]
    parts.append(PagePart(heading="In words", text=format_combination(found)))
    return write_head_page(folder, "several sources in one rig", "Combined", parts, _verdict(found))


def _verdict(found: Combination) -> list[str]:
    names = ", ".join(source.name for source in found.sources)
    lines = [f"{names} agree: chi-square {found.chi_square:.1f} of {found.degrees}"]
    for first, second in combinations(found.rig.names, 2):
        sigma = relative_direction(found.rig, first, second)
        if sigma is not None:
            lines.append(
                f"{first} against {second} is known to {sigma.pan_deg:.4f} deg in pan, {sigma.tilt_deg:.4f} deg in tilt"
            )
    return lines


def _draw_sigmas(figure: Figure, found: Combination, first: str, second: str) -> None:
    rigs: list[tuple[str, Rig]] = [(source.name, source.rig) for source in found.sources]
    axes = figure.subplots()
    shown = [
        (name, s) for name, rig in [*rigs, ("together", found.rig)] if (s := relative_direction(rig, first, second))
    ]
    for k, (_, sigma) in enumerate(shown):
        for side, value in ((-0.5, sigma.pan_deg), (0.5, sigma.tilt_deg)):
            colour = _COLOURS[0] if side < 0.0 else _COLOURS[2]
            axes.bar(k + side * _BAR, value, _BAR, color=colour, label=("pan", "tilt")[side > 0.0] if k == 0 else None)
    axes.set_xticks(range(len(shown)), [name for name, _ in shown], rotation=20 if len(shown) > 3 else 0)
    axes.set_ylabel("1 sigma, deg")
    axes.legend(frameon=False)


def _draw_directions(figure: Figure, found: Combination, station: Station) -> None:
    readings = readings_of(station)
    pan = np.degrees(readings[:, 0])
    for axis, (plot, word) in enumerate(zip(figure.subplots(2, 1, sharex=True), ("pan", "tilt"), strict=True)):
        plot.axhline(0.0, color=_TOGETHER, lw=1)
        for colour, source in zip(_COLOURS * 11, found.sources, strict=False):
            turned = _in_the_frame(source.rig[station.name], found.heading_rad if source.from_north else None)
            own = _off_deg(turned, station, readings)
            plot.plot(pan, own[:, axis], ".", ms=8, color=colour, label=source.name)
        plot.set_ylabel(f"{word} off, deg")
    plot.set_xlabel("pan, deg")
    plot.legend(frameon=False, fontsize=10)


def _in_the_frame(station: Station, heading_rad: float | None) -> Station:
    """Return a station with the turn of its frame taken out."""
    change = np.zeros(len(CALIBRATION_PARAMETERS))
    change[CALIBRATION_PARAMETERS.index("runway_from_base.z")] = -(heading_rad or 0.0)
    return station.changed(change)


def _off_deg(station: Station, result: Station, readings: FloatArray) -> FloatArray:
    """Return how far (n, 2) a rig's directions are from the result's, across and up, degrees."""
    n = len(readings)
    moved = directions(station, readings) - directions(result, readings)
    return np.degrees(across_and_up(moved.reshape(-1, 1), result, readings)[:n, :, 0])
