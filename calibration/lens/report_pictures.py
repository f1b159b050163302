"""The pictures of a lens calibration: corners, residuals, uncertainty of the lens."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from calibration.lens.advice import tilts_deg
from calibration.lens.intrinsics import Intrinsics
from calibration.report.drawing import BLUE, GREEN, ORANGE, TITLED, png_of
from calibration.report.picture import ReportPicture

_EDGED: list[AbstractPathEffect] = [withStroke(linewidth=3.0, foreground="#00204C")]


def lens_pictures(found: Intrinsics) -> list[ReportPicture]:
    """Draw all pictures of a calibration; needs no window system."""
    pictures = []
    for name, title, caption, draw in (
        (
            "coverage",
            "Where corners were seen",
            "Each dot is a corner, each outline a board. What no board has covered, the lens there is a guess.",
            _coverage,
        ),
        (
            "poses",
            "Tilt and distance of the boards",
            "Steep boards at several distances tell focal length from distance; boards parallel to the image do not.",
            _poses,
        ),
        (
            "residuals",
            "What is left over",
            "Mean found minus predicted pixel in cells of the image. Without order it is noise; a pattern is a lens "
            "that the model cannot follow, or a board that is not flat.",
            _residuals,
        ),
        (
            "uncertainty",
            "How well the lens is known",
            "One sigma in px of where a far point is seen, the camera's orientation found with this very lens.",
            _uncertainty,
        ),
    ):
        png = png_of(draw, found, style=TITLED)
        pictures.append(ReportPicture(name=name, title=title, caption=caption, png=png))
    return pictures


def _image_axes(ax: Axes, found: Intrinsics) -> None:
    w, h = found.fit.lens.image_size_px
    ax.set_xlim(-0.5, w - 0.5)
    ax.set_ylim(h - 0.5, -0.5)
    ax.set_aspect("equal")
    ax.set_xlabel("u in px")
    ax.set_ylabel("v in px")
    for side in ("top", "right"):
        ax.spines[side].set_visible(True)


def _coverage(figure: Figure, found: Intrinsics) -> None:
    ax = figure.subplots()
    for view in found.views:
        hull = _hull(view.pixel)
        ax.fill(hull[:, 0], hull[:, 1], facecolor=BLUE, alpha=0.06, edgecolor=BLUE, lw=0.8)
    pixel = np.vstack([view.pixel for view in found.views])
    ax.plot(pixel[:, 0], pixel[:, 1], ".", ms=3.5, color=ORANGE)
    _image_axes(ax, found)
    ax.set_title(f"{len(found.views)} views, {len(pixel)} corners")


def _hull(pixel: Any) -> Any:
    """Return the points' convex hull, in turn."""
    from scipy.spatial import ConvexHull

    return pixel[ConvexHull(pixel).vertices]


def _poses(figure: Figure, found: Intrinsics) -> None:
    ax = figure.subplots()
    distances = [float(np.linalg.norm(t)) for t in found.fit.translation_m]
    ax.axvspan(20, 50, color=GREEN, alpha=0.10, lw=0)
    ax.text(35, 0.02, "most telling", transform=ax.get_xaxis_transform(), color="#00654a", ha="center", va="bottom")
    ax.plot(tilts_deg(found), distances, "o", ms=8, color=BLUE, mec="white")
    ax.set_xlim(0, 70)
    ax.set_ylim(0, 1.15 * max(distances))
    ax.grid(color="#dddddd", lw=0.7)
    ax.set_xlabel("tilt against the image plane in °")
    ax.set_ylabel("distance in m")
    ax.set_title(f"focal length and distance correlate by {found.fit.focal_distance_correlation:+.3f}")


def _residuals(figure: Figure, found: Intrinsics) -> None:
    ax = figure.subplots()
    pixel = np.vstack([view.pixel for view in found.views])
    residual = np.vstack(found.fit.residual)
    w, h = found.fit.lens.image_size_px
    columns = 12
    cell = w / columns
    rows = max(1, round(h / cell))
    place = np.floor(pixel / (w / columns, h / rows)).astype(int)
    number = np.clip(place[:, 0], 0, columns - 1) + columns * np.clip(place[:, 1], 0, rows - 1)
    cells = [number == n for n in np.unique(number) if np.sum(number == n) >= 3]
    ax.plot(pixel[:, 0], pixel[:, 1], ".", ms=2, color="#c8cdd2")
    if cells:
        at = np.array([pixel[c].mean(axis=0) for c in cells])
        mean = np.array([residual[c].mean(axis=0) for c in cells])
        scale = _round_scale(float(np.percentile(np.linalg.norm(mean, axis=1), 90)))
        arrows = ax.quiver(*at.T, *mean.T, angles="xy", scale_units="xy", scale=scale / cell, color=BLUE, width=0.006)
        ax.quiverkey(arrows, 0.86, 1.035, scale, f"{scale:g} px", labelpos="E")
    _image_axes(ax, found)
    ax.set_title(f"rms {found.fit.rms_px:.3f} px, held out {found.held_out.rms_px:.3f} px")


def _round_scale(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, near the value."""
    if not value > 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(m * power - value)) * power)


def _uncertainty(figure: Figure, found: Intrinsics) -> None:
    ax = figure.subplots()
    shown = found.map.aligned_px
    mesh = ax.pcolormesh(found.map.u_px, found.map.v_px, shown, cmap="cividis", shading="gouraud", norm=LogNorm())
    bar = figure.colorbar(mesh, ax=ax, location="bottom", aspect=40, pad=0.02)
    bar.set_label("1 σ in px")
    bar.ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    bar.ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    bar.ax.xaxis.set_minor_formatter(NullFormatter())
    steps = [m * p for p in (0.001, 0.01, 0.1, 1.0, 10.0) for m in (1, 2, 5)]
    levels = [v for v in steps if shown.min() < v < shown.max()]
    if levels:
        lines = ax.contour(found.map.u_px, found.map.v_px, shown, levels=levels, colors="white", linewidths=1.4)
        lines.set(path_effects=_EDGED)
        for text in ax.clabel(lines, fmt=lambda v: f"{v:g}", fontsize=12):
            text.set_path_effects(_EDGED)
    _image_axes(ax, found)
    ax.set_title(f"worst {shown.max():.2g} px = {found.map.aligned_deg.max():.2g}°")
