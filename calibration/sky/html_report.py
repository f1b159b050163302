"""report.html of a calibration by airliners and the Moon: what is left over of each, pointings, the latency."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.report.drawing import ORANGE, png_of
from calibration.report.head_page import PagePart, station_heading, write_head_page
from calibration.report.picture import ReportPicture
from calibration.sky.calibrate import SkyCalibration
from calibration.sky.pass_results import (
    PassLatency,
    StationResiduals,
    body_labels,
    pass_latency,
    pass_place,
    station_residuals,
)
from calibration.sky.text_report import format_sky, what_is_open, what_is_told

_COLOURS = ("#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#5B4A8A")
_MOON_COLOUR = "#1b1f24"
_GREY = "#9aa0a6"
# of a pass's column, the width over which its pictures lie in order of time
_SPREAD = 0.6
_MOST_NAMED = 8


def write_sky_page(folder: Path, found: SkyCalibration) -> list[Path]:
    """Write report.html and its pictures as PNG into ``folder``, created if missing; returns the written files."""
    residuals = [station_residuals(found, k) for k in range(len(found.night.joint.nights))]
    names = [night.before.name for night in found.night.joint.nights]
    parts = [
        PagePart(heading="What the pictures could not tell", items=what_is_open(found) or ["nothing of note"]),
        PagePart(
            heading="Airliners and the Moon",
            table=_table(found, names, residuals),
            pictures=_latency_pictures(found),
        ),
        *(
            PagePart(heading=station_heading(name), pictures=_station_pictures(found, name, own))
            for name, own in zip(names, residuals, strict=True)
        ),
        PagePart(heading="In words", text=format_sky(found)),
    ]
    return write_head_page(folder, "heads by airliners and the Moon", "Sky", parts, what_is_told(found))


def _seen_bodies(found: SkyCalibration, residuals: Sequence[StationResiduals]) -> list[int]:
    """Return the numbers of the passes, and of the Moon, that any station has a sighting of."""
    return [n for n in range(len(found.flights) + 1) if any(np.any(own.body == n) for own in residuals)]


def _table(found: SkyCalibration, names: Sequence[str], residuals: Sequence[StationResiduals]) -> list[list[str]]:
    head = ["", "distance, km", "height, deg", "positions", "their scatter, m", "late by, s"]
    for name in names:
        head += [f"{name}: used", f"{name}: left over in pan; tilt, deg"]
    rows = [head]
    labels = body_labels(found)
    for number in _seen_bodies(found, residuals):
        row = [labels[number], "", "", "", "", ""]
        if number < len(found.flights):
            path, late = found.flights[number], pass_latency(found, number)
            place = pass_place(path)
            row = [
                labels[number],
                f"{place.away_km[0]:.0f} to {place.away_km[1]:.0f}",
                f"{place.up_deg[0]:.0f} to {place.up_deg[1]:.0f}",
                str(path.reports),
                f"{path.report_m:.0f}",
                "" if late is None else f"{late.latency_s:.2f} ± {late.sigma_s:.2f}",
            ]
        for own in residuals:
            these, rms = own.body == number, own.rms_deg(number)
            row.append(f"{int((these & own.kept).sum())} of {int(these.sum())}")
            row.append("" if rms is None else f"{rms[0]:.4f}; {rms[1]:.4f}")
        rows.append(row)
    return rows


def _latency_pictures(found: SkyCalibration) -> list[ReportPicture]:
    late = {n: value for n in range(len(found.flights)) if (value := pass_latency(found, n)) is not None}
    if found.latency_s is None or found.latency_sigma_s is None or not late:
        return []
    return [
        ReportPicture(
            name="latency",
            title="Latency of positions",
            caption="By how much each airliner's positions are stamped late, with one sigma: the receiver's latency"
            " (line, with one sigma), which is common to all, and the aircraft's own.",
            png=png_of(_draw_latency, found, late),
        )
    ]


def _draw_latency(figure: Figure, found: SkyCalibration, late: dict[int, PassLatency]) -> None:
    axes, labels = figure.subplots(), body_labels(found)
    common, sigma = found.latency_s or 0.0, found.latency_sigma_s or 0.0
    axes.axhspan(common - sigma, common + sigma, color=_GREY, alpha=0.25, lw=0)
    axes.axhline(common, color=_GREY, lw=1.5)
    for place, (number, one) in enumerate(late.items()):
        axes.errorbar(place, one.latency_s, one.sigma_s, fmt="o", ms=7, capsize=4, color=_colour(found, number))
    _name_columns(axes, [labels[n] for n in late])
    axes.set_ylabel("late by, s")


def _station_pictures(found: SkyCalibration, name: str, own: StationResiduals) -> list[ReportPicture]:
    return [
        ReportPicture(
            name=f"{name}-left-over",
            title="What is left over",
            caption="Each dot is a picture, in order of time: how far its airliner was from where the result puts it."
            " One airliner off as a whole: its positions are. A slope: its latency. Orange crosses: left out.",
            png=png_of(_draw_left_over, found, own),
        ),
        ReportPicture(
            name=f"{name}-pointings",
            title="Where the head looked",
            caption="The readings of each picture in the colour of its airliner (black: the Moon), and what is left"
            " over as an arrow. What no picture is near, the day says little of.",
            png=png_of(_draw_pointings, found, own),
        ),
    ]


def _draw_left_over(figure: Figure, found: SkyCalibration, own: StationResiduals) -> None:
    labels, bodies = body_labels(found), _seen_bodies(found, [own])
    for axis, (plot, word) in enumerate(zip(figure.subplots(2, 1, sharex=True), ("pan", "tilt"), strict=True)):
        plot.axhline(0.0, color="0.7", lw=1)
        limit = 1.2 * float(np.abs(own.turned_deg[own.kept, axis]).max(initial=1e-4))
        for place, number in enumerate(bodies):
            rows = np.flatnonzero(own.body == number)
            x = place + _SPREAD * (np.linspace(-0.5, 0.5, len(rows)) if len(rows) > 1 else np.zeros(1))
            kept, left = own.kept[rows], own.turned_deg[rows, axis]
            plot.plot(x[kept], left[kept], ".", ms=7, color=_colour(found, number))
            plot.plot(x[~kept], np.clip(left[~kept], -limit, limit), "x", color=ORANGE)
        plot.set(ylim=(-1.05 * limit, 1.05 * limit), ylabel=f"{word} left over, deg")
    _name_columns(plot, [labels[n] for n in bodies])


def _draw_pointings(figure: Figure, found: SkyCalibration, own: StationResiduals) -> None:
    axes, labels = figure.subplots(), body_labels(found)
    bodies = _seen_bodies(found, [own])
    for number in bodies:
        rows = own.kept & (own.body == number)
        label = labels[number] if len(bodies) <= _MOST_NAMED else None
        axes.plot(*own.reading_deg[rows].T, ".", ms=7, color=_colour(found, number), label=label)
    arrows = axes.quiver(
        *own.reading_deg[own.kept].T,
        *own.turned_deg[own.kept].T,
        angles="xy",
        scale_units="xy",
        scale=1 / 500,
        width=0.002,
        color=_GREY,
    )
    axes.quiverkey(arrows, 0.85, 1.04, 0.01, "0.01 deg", labelpos="E")
    axes.set_title(" ")
    axes.set(xlabel="pan, deg", ylabel="tilt, deg")
    axes.margins(0.15)
    if len(bodies) <= _MOST_NAMED:
        axes.legend(frameon=False, fontsize=10, ncols=2)


def _name_columns(axes: Axes, labels: Sequence[str]) -> None:
    axes.set_xticks(range(len(labels)), labels, rotation=0 if len(labels) <= _MOST_NAMED // 2 else 45)
    axes.set_xlim(-0.6, len(labels) - 0.4)


def _colour(found: SkyCalibration, number: int) -> str:
    return _MOON_COLOUR if number == len(found.flights) else _COLOURS[number % len(_COLOURS)]
