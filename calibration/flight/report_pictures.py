"""The pictures of a flight's calibration: flown path, residuals, correlations, quality."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.flight.fit import FlightFit
from calibration.flight.problem import DGPS_OFFSET
from calibration.flight.verdict import FlightVerdict
from calibration.report.drawing import TITLED, png_of
from calibration.report.picture import ReportPicture
from groundstation.arrays import FloatArray
from groundstation.rig.rig import Rig

_DPI = 130
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_SOFT = "#c8cdd2"
_STYLE: dict[Any, Any] = {**TITLED, "font.size": 11, "axes.titlesize": 11, "legend.frameon": False}
_CELLS = 12
_LEAST_IN_CELL = 3
_MOST_LABELS = 24
# residuals beyond so many times the kept ones' spread are drawn at the border
_SHOWN_SPREAD = 5.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Content:
    after: Rig
    fit: FlightFit
    verdict: FlightVerdict


_WantedPicture = tuple[str, str, str, tuple[float, float], Callable[[Figure, _Content], None]]


def flight_pictures(after: Rig, fit: FlightFit, verdict: FlightVerdict) -> list[ReportPicture]:
    """Draw all pictures of a calibration; needs no window system."""
    content = _Content(after=after, fit=fit, verdict=verdict)
    wanted = _pictures_of(content)
    if not verdict.ranges:
        wanted = [w for w in wanted if w[0] != "ranges"]
    if not np.isfinite(fit.problem.prior_sigma).any():
        wanted = [w for w in wanted if w[0] != "learnt"]
    return [
        ReportPicture(
            name=name, title=title, caption=caption, png=png_of(draw, content, style=_STYLE, size_in=size, dpi=_DPI)
        )
        for name, title, caption, size, draw in wanted
    ]


def _pictures_of(content: _Content) -> list[_WantedPicture]:
    """Return name, title, caption, size in inches and drawing function of each picture."""
    rows = len(content.fit.stations)
    return [
        (
            "geometry",
            "Flight path, and observations by station",
            "Stations, the DGPS path (grey), and the part that each station observed. A path that leaves the straight "
            "line, near and far, separates parameters.",
            (6.4, 6.4),
            _geometry,
        ),
        (
            "over_time",
            "What is left over, over time",
            "Predicted minus seen pixel. Without order it is noise; steps and slopes are clocks, mounts or labels. "
            "Crosses were left out.",
            (6.4, 1.0 + 1.9 * rows),
            _over_time,
        ),
        (
            "over_image",
            "What is left over, over the picture",
            "Mean predicted minus seen pixel in cells of each station's picture. A pattern is a lens that does not "
            "fit, or a target point that shifts.",
            (6.4, 0.6 + 3.6 * ((rows + 1) // 2)),
            _over_image,
        ),
        (
            "correlations",
            "Correlations of the parameters",
            "Correlations of all parameters: dark squares off the diagonal are pairs of which the flight knows a "
            "combination only.",
            (6.4, 6.0),
            _correlations,
        ),
        (
            "learnt",
            "Reduction of the uncertainty",
            "One sigma after the flight over one sigma before it, where something was known before. Near 1, nothing "
            "was learnt.",
            (6.4, 1.2 + 0.22 * min(len(content.fit.problem.names), 80)),
            _learnt,
        ),
        (
            "ranges",
            "What that is in the air",
            "One sigma of one fix: what is left of the calibration (filled) and pixels with encoders (hollow).",
            (6.4, 4.2),
            _ranges,
        ),
    ]


def _geometry(figure: Figure, content: _Content) -> None:
    problem, fit = content.fit.problem, content.fit
    above, side = figure.subplots(2, 1, height_ratios=(2.0, 1.0))
    first, last = problem.track.span_s
    whole = problem.track.at(np.linspace(first, last, 1500))
    path = np.where(whole.usable[:, None], whole.position_m, np.nan)
    for ax, vertical in ((above, 1), (side, 2)):
        ax.plot(path[:, 0], path[:, vertical], color=_SOFT, lw=1.2, zorder=1)
        for colour, (name, observed) in zip(
            _cycle(len(problem.observations)), problem.observations.items(), strict=True
        ):
            later_s = (problem.value(fit.change, clock) for clock in (f"{name}.camera_clock.offset", DGPS_OFFSET))
            seen = problem.track.at(observed.t_s + sum(later_s))
            shown = seen.position_m[seen.usable & fit.stations[name].kept]
            ax.plot(shown[:, 0], shown[:, vertical], ".", ms=2.5, color=colour, zorder=2)
            place = content.after[name].ptu_position_m
            ax.plot(place[0], place[vertical], "^", ms=9, color=colour, mec="white", label=name, zorder=3)
    above.set_aspect("equal", adjustable="datalim")
    above.set_ylabel("y in m")
    above.set_title("from above")
    above.legend(loc="best", fontsize=9)
    side.set_xlabel("x in m")
    side.set_ylabel("z in m")
    side.set_title("from the side")


def _cycle(n: int) -> list[str]:
    return [_COLOURS[k % len(_COLOURS)] for k in range(n)]


def _over_time(figure: Figure, content: _Content) -> None:
    fit = content.fit
    axes = np.atleast_1d(figure.subplots(len(fit.stations), 1, sharex=True))
    for ax, (name, station) in zip(axes, fit.stations.items(), strict=True):
        t, off = fit.problem.observations[name].t_s, station.residual_px
        kept = station.kept
        limit = max(_SHOWN_SPREAD * float(np.std(off[kept])) if kept.any() else 1.0, 1e-3)
        for colour, axis, letter in ((_COLOURS[0], 0, "u"), (_COLOURS[1], 1, "v")):
            ax.plot(t[kept], off[kept, axis], ".", ms=2, color=colour, label=letter)
            gross = station.usable & ~kept
            ax.plot(t[gross], np.clip(off[gross, axis], -limit, limit), "x", ms=4, color=colour, alpha=0.6)
        ax.axhline(0.0, color="#5a636e", lw=0.7)
        ax.set_ylim(-1.05 * limit, 1.05 * limit)
        ax.set_ylabel("px")
        ax.set_title(f"{name}: {station.rms_px:.2f} px rms, {int(kept.sum())} pixels")
    axes[0].legend(loc="upper right", ncols=2, markerscale=4, fontsize=9)
    axes[-1].set_xlabel("session time in s")


def _over_image(figure: Figure, content: _Content) -> None:
    fit = content.fit
    count = len(fit.stations)
    columns = 1 if count == 1 else 2
    axes = np.atleast_1d(figure.subplots(-(-count // columns), columns)).ravel()
    for ax in axes[count:]:
        ax.set_axis_off()
    for ax, (name, station) in zip(axes[:count], fit.stations.items(), strict=True):
        _arrows(ax, fit.problem.observations[name].pixel_px[station.kept], station.residual_px[station.kept])
        left, right, top, bottom = _seen_part(content, name)
        ax.set_xlim(left, right)
        ax.set_ylim(bottom, top)
        ax.set_aspect("equal")
        for edge in ("top", "right"):
            ax.spines[edge].set_visible(True)
        ax.set_title(name)


def _seen_part(content: _Content, name: str) -> tuple[float, float, float, float]:
    """Return left, right, top and bottom of the picture, or of the part of it in which all pixels are."""
    w, h = content.after[name].lens.image_size_px
    pixel = content.fit.problem.observations[name].pixel_px[content.fit.stations[name].kept]
    if not len(pixel) or float(np.ptp(pixel, axis=0).max()) > w / 3.0:
        return (-0.5, w - 0.5, -0.5, h - 0.5)
    u, v = 0.5 * (pixel.min(axis=0) + pixel.max(axis=0))
    half = 0.65 * max(float(np.ptp(pixel, axis=0).max()), 10.0)
    return (u - half, u + half, v - half, v + half)


def _arrows(ax: Axes, pixel: FloatArray, off: FloatArray) -> None:
    """Draw the mean residual of each cell of the part of the picture that was seen."""
    if not len(pixel):
        return
    ax.plot(pixel[:, 0], pixel[:, 1], ".", ms=1.5, color=_SOFT)
    cell = max(float(np.ptp(pixel, axis=0).max()) / _CELLS, 1.0)
    number = np.floor((pixel - pixel.min(axis=0)) / cell).astype(int) @ np.array([1, 1000])
    cells = [number == n for n in np.unique(number) if np.sum(number == n) >= _LEAST_IN_CELL]
    if not cells:
        return
    at = np.array([pixel[c].mean(axis=0) for c in cells])
    mean = np.array([off[c].mean(axis=0) for c in cells])
    scale = max(float(np.percentile(np.linalg.norm(mean, axis=1), 90)), 1e-3)
    how: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": scale / cell, "color": _COLOURS[0]}
    arrows = ax.quiver(*at.T, *mean.T, width=0.006, **how)
    ax.quiverkey(arrows, 0.78, 1.05, scale, f"{scale:.2g} px", labelpos="E")


def _correlations(figure: Figure, content: _Content) -> None:
    ax = figure.subplots()
    names = content.fit.problem.names
    picture = ax.imshow(content.fit.correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    figure.colorbar(picture, ax=ax, shrink=0.7)
    if len(names) <= _MOST_LABELS:
        ax.set_xticks(range(len(names)), names, rotation=90, fontsize=8)
        ax.set_yticks(range(len(names)), names, fontsize=8)
        return
    # too many to read: where each station begins
    owners = [name.partition(".")[0] for name in names]
    starts = [k for k in range(len(owners)) if k == 0 or owners[k] != owners[k - 1]]
    ax.set_xticks(starts, [owners[k] for k in starts], rotation=90, fontsize=9)
    ax.set_yticks(starts, [owners[k] for k in starts], fontsize=9)
    for k in starts[1:]:
        ax.axhline(k - 0.5, color="#5a636e", lw=0.6)
        ax.axvline(k - 0.5, color="#5a636e", lw=0.6)


def _learnt(figure: Figure, content: _Content) -> None:
    ax = figure.subplots()
    fit = content.fit
    known = np.flatnonzero(np.isfinite(fit.problem.prior_sigma))
    share = fit.sigma[known] / fit.problem.prior_sigma[known]
    places = np.arange(len(known))
    ax.hlines(places, share, 1.0, color=_SOFT, lw=3)
    ax.plot(share, places, "o", color=_COLOURS[0], ms=5)
    ax.set_xscale("log")
    ax.set_yticks(places, [fit.problem.names[k] for k in known], fontsize=8)
    ax.set_ylim(len(known) - 0.4, -0.6)
    ax.set_xlabel("sigma after / sigma before")
    ax.grid(axis="x", color="#dddddd", lw=0.7)


def _ranges(figure: Figure, content: _Content) -> None:
    ax = figure.subplots()
    ranges = content.verdict.ranges
    away = [q.range_m for q in ranges]
    for axis, (name, colour) in enumerate(zip(("along", "across", "up"), _COLOURS, strict=False)):
        ax.plot(away, [q.calibration_m[axis] for q in ranges], "o-", color=colour, label=f"{name}: calibration")
        ax.plot(away, [q.noise_m[axis] for q in ranges], "o--", mfc="white", color=colour, label=f"{name}: one fix")
    ax.set_yscale("log")
    ax.set_xlabel("range in m")
    ax.set_ylabel("1 σ in m")
    ax.grid(color="#dddddd", lw=0.7)
    ax.legend(fontsize=9, ncols=3, loc="upper left", bbox_to_anchor=(0.0, 1.22))
