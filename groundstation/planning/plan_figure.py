"""The picture of a plan: sigma over range, axis by axis, and the site from above. Legible on a small screen."""

import io
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from groundstation.arrays import FloatArray, MaskArray
from groundstation.planning.forecast import Forecast
from groundstation.planning.site import Site

# Okabe and Ito's palette, distinguishable with any colour vision; each line also has a dash of its own
_FIX, _TRACK, _TOTAL, _WANTED = "#E69F00", "#0072B2", "#000000", "#CC79A7"
_WANTED_DASHES: tuple[Any, ...] = ((0, (1, 1.5)), (0, (5, 1, 1, 1)), (0, (8, 2)))
# white on yellow would be lost
_EDGED = [withStroke(linewidth=3.2, foreground="#00204C")]
_SIZE_IN = (6.4, 11.6)
_DPI = 170
_AXIS_NAMES = ("x, across", "y, along the runway", "z, up")
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "groundstation",
    "font.family": ["sans-serif"],
    "font.size": 13,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 12,
}


def draw_plan(site: Site, f: Forecast, x_m: FloatArray, y_m: FloatArray, map_sigma_m: FloatArray) -> dict[str, bytes]:
    """Return the picture as files, by suffix: ``.png`` and ``.svg``.

    ``map_sigma_m`` (rows of ``y_m``, columns of ``x_m``) is `forecast.site_map`, NaN where there is no position.
    """
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=_SIZE_IN, layout="constrained")
        panels = figure.subplots(4, 1, height_ratios=(1, 1, 1, 2.1))
        for axis in range(3):
            _sigma_panel(panels[axis], site, f, axis)
        panels[2].set_xlabel("range y in m")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=2, columnspacing=1.4, handlelength=2.6)
        _map_panel(figure, panels[3], site, x_m, y_m, map_sigma_m)
        files = {}
        for suffix in ("png", "svg"):
            buffer = io.BytesIO()
            metadata = {"Date": None, "Creator": None} if suffix == "svg" else {"Software": None}
            figure.savefig(buffer, format=suffix, dpi=_DPI, metadata=metadata)
            files[f".{suffix}"] = buffer.getvalue()
    return files


def _sigma_panel(ax: Axes, site: Site, f: Forecast, axis: int) -> None:
    """Draw one axis's sigmas over range."""
    for values, known, colour, dash, width, name in (
        (f.fix_noise_m, f.fix_known, _FIX, "-.", 1.8, "one pair of frames, noise"),
        (f.track_noise_m, f.track_known, _TRACK, "--", 1.8, "tracked, noise"),
        (f.track_sigma_m, f.track_known, _TOTAL, "-", 2.6, "tracked, with calibration"),
    ):
        ax.plot(f.range_m, _gapped(values[:, axis], known), color=colour, ls=dash, lw=width, label=name)
    for k, wanted in enumerate(site.required):
        dash = _WANTED_DASHES[k % len(_WANTED_DASHES)]
        label = f"wanted: {_shortened(wanted.name)}"
        ax.axhline(wanted.sigma_m[axis], color=_WANTED, ls=dash, lw=1.8, label=label)
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    # a decade or more gets its decades and the 2 and 5 between; a long axis the decades alone
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high / low > 300 else (1.0, 3.0)))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(FuncFormatter(_metres))
    ax.set_ylabel("1 σ in m")
    ax.set_title(_AXIS_NAMES[axis], fontsize=13, loc="left", pad=3)
    ax.set_xlim(0.0, site.to_m)


def _metres(value: float, _: object) -> str:
    return f"{value:g}"


def _shortened(name: str) -> str:
    return name if len(name) <= 18 else name[:17] + "…"


def _gapped(values: FloatArray, known: MaskArray) -> FloatArray:
    """Return values with NaN where unknown, so that no line is drawn across."""
    return np.where(known, values, np.nan)


def _contours(ax: Axes, x_m: FloatArray, y_m: FloatArray, shown: Any, low: float, high: float) -> None:
    """Draw the contours with horizontal labels next to the flight path."""
    levels = [v for v in (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0) if low < v < high]
    if not levels:
        return
    lines = ax.contour(y_m, x_m, shown, levels=levels, colors="white", linewidths=1.3)
    lines.set(path_effects=_EDGED)
    label_x_m = x_m[len(x_m) // 4]
    # a level is labelled where it crosses this row last; near the stations it may cross more than once
    row = np.log(shown[len(x_m) // 4].filled(np.nan))
    for v in levels:
        crossed = np.flatnonzero(np.diff(np.sign(row - np.log(v))))
        if len(crossed):
            place = (float(y_m[crossed[-1]]), float(label_x_m))
            ax.annotate(f"{v:g} m", place, fontsize=12, color="white", ha="center", path_effects=_EDGED)


def _map_panel(figure: Figure, ax: Axes, site: Site, x_m: FloatArray, y_m: FloatArray, map_sigma_m: FloatArray) -> None:
    """Draw the site from above, range to the right as in the panels above it."""
    shown = np.ma.masked_invalid(np.clip(map_sigma_m.T, 1e-6, None))
    if shown.count():
        low, high = np.nanpercentile(map_sigma_m, [1, 99])
        norm = LogNorm(max(low, 1e-6), max(high, 1.01 * low, 1.1e-6))
        mesh = ax.pcolormesh(y_m, x_m, shown, norm=norm, cmap="cividis", shading="gouraud")
        mesh.set_rasterized(True)
        bar = figure.colorbar(mesh, ax=ax, location="bottom", aspect=40, pad=0.02, extend="both")
        bar.set_label("1 σ of the worst axis in m: one pair of frames, with calibration")
        bar.ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        bar.ax.xaxis.set_major_formatter(FuncFormatter(_metres))
        bar.ax.xaxis.set_minor_formatter(NullFormatter())
        _contours(ax, x_m, y_m, shown, low, high)
    glide = [site.aircraft.x_m, site.aircraft.x_m]
    ax.plot([site.from_m, site.to_m], glide, color="white", lw=2.0, ls="--", path_effects=_EDGED)
    tip_m = site.from_m + 0.06 * (site.to_m - site.from_m)
    arrow = {"arrowstyle": "-|>", "color": "white", "lw": 2.0, "mutation_scale": 22, "path_effects": _EDGED}
    ax.annotate("", (site.from_m, glide[0]), (tip_m, glide[0]), arrowprops=arrow)
    for station in site.rig.stations:
        ax.plot(
            *station.ptu_position_m[1::-1], "^", ms=11, color="#D55E00", mec="white", mew=1.2, clip_on=False, zorder=5
        )
    ax.set_xlim(min(0.0, y_m[0]), y_m[-1])
    # x is to the right of someone looking along +y, which here is downwards
    ax.set_ylim(x_m[-1], x_m[0])
    ax.grid(visible=False)
    ax.set_xlabel("range y in m")
    ax.set_ylabel("x in m")
    ax.set_title("from above: stations (triangles), flight path", fontsize=13, loc="left", pad=5)
