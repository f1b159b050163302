"""Figures of the study, in Okabe and Ito's palette with a separate marker for each series."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from groundstation.experiments.detection_tables import WIDTHS_PX, of_phase
from groundstation.experiments.detector_outcomes import DetectorOutcome

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
PNG_DPI = 130
SHADES = {"mixed": "#F0E442", "ground": "#8C6D46"}


def blank(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    """Return an empty figure of this size in inches, and its panels, row by row."""
    figure = Figure(figsize=size, layout="constrained")
    axes = [figure.add_subplot(rows, columns, k + 1) for k in range(rows * columns)]
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(color="#dddddd", linewidth=0.6)
        ax.set_axisbelow(True)
    return figure, axes


def save(figure: Figure, path: Path) -> None:
    """Write the figure as PNG."""
    # without the date and the version, equal data give equal files
    figure.savefig(path, dpi=PNG_DPI, metadata={"Software": None})


def draw_roi_sweep(sweep: Mapping[str, Sequence[DetectorOutcome]], full: str, path: Path) -> None:
    """Draw time and deviation against the basic size."""
    figure, (times, off) = blank(1, 2, (9.0, 3.6))
    names = list(sweep)
    for k, (label, of) in enumerate((("detector", "elapsed_s"), ("segmentation", "segment_s"))):
        values = [1e3 * np.array([getattr(o, of) for o in sweep[n]]) for n in names]
        place = np.arange(len(names)) + 0.12 * (2 * k - 1)
        low, middle, high = (np.array([np.percentile(v, q) for v in values]) for q in (5, 50, 95))
        spread = [middle - low, high - middle]
        times.errorbar(place, middle, spread, fmt=MARKERS[k], color=COLOURS[k], label=f"{label}, 5–50–95 %", capsize=2)
    times.set_yscale("log")
    times.set_ylabel("ms per frame")
    others = [n for n in names if n != full]
    for axis, label in enumerate("uv"):
        rms = []
        for name in others:
            pairs = [(o, f) for o, f in zip(sweep[name], sweep[full], strict=True) if o.found and f.found]
            rms.append(np.sqrt(np.mean([(o.point_px[axis] - f.point_px[axis]) ** 2 for o, f in pairs])))
        off.plot(range(len(others)), rms, marker=MARKERS[axis], color=COLOURS[axis], label=label)
    off.axhline(1.0, color="#000000", linestyle="--", linewidth=1, label="paper, 250×100: below this on average")
    off.set_ylabel("rms deviation from full frame, px")
    for ax, ticks in ((times, names), (off, others)):
        ax.set_xticks(range(len(ticks)), ticks, rotation=40, ha="right")
        ax.set_xlabel("basic size of the ROI, px")
        ax.legend(frameon=False, fontsize=8)
    save(figure, path)


def draw_methods(methods: Mapping[str, Sequence[DetectorOutcome]], path: Path) -> None:
    """Draw overlap and the point's error over time, one camera, and the time of each method."""
    figure, (overlap, error, times) = blank(3, 1, (9.0, 9.0))
    for k, (name, every) in enumerate(methods.items()):
        first = min(o.station for o in every)
        shown = [o for o in every if o.station == first]
        t = np.array([o.t_s for o in shown])
        style: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "linewidth": 1.1, "label": name}
        overlap.plot(t, [o.overlap for o in shown], **style)
        error.semilogy(t, [max(float(np.hypot(*o.error_px)), 0.02) if o.found else np.nan for o in shown], **style)
        values = [1e3 * o.segment_s for o in every]
        times.plot(np.sort(values), np.linspace(0, 100, len(values)), **style)
    any_method = next(iter(methods.values()))
    for ax in (overlap, error):
        for phase, shade in SHADES.items():
            shaded = [o.t_s for o in of_phase(any_method, phase)]
            if shaded:
                ax.axvspan(min(shaded), max(shaded), color=shade, alpha=0.15, lw=0)
        ax.set_xlabel("time, s (tinted: mixed background, then ground)")
    overlap.set_ylabel("IoU with truth (0: missed)")
    error.set_ylabel("point from nose, px")
    times.set_xscale("log")
    times.set_xlabel("ms per segmentation")
    times.set_ylabel("% of frames at most")
    overlap.legend(frameon=False, fontsize=8, ncols=3, loc="upper left")
    overlap.set_ylim(0, 1.2)
    save(figure, path)


def draw_accuracy(outcomes: Sequence[DetectorOutcome], path: Path) -> None:
    """Draw every error against the silhouette's width, and the mean normalised square by class of width."""
    figure, axes = blank(1, 3, (11.0, 3.6))
    found = [o for o in outcomes if o.found]
    width = np.array([o.width_px for o in found])
    for axis, label in enumerate("uv"):
        for k, phase in enumerate(("sky", "mixed", "ground")):
            chosen = np.array([o.background == phase for o in found])
            value = np.array([o.error_px[axis] for o in found])
            axes[axis].plot(width[chosen], value[chosen], MARKERS[k], ms=3, color=COLOURS[k], label=phase, alpha=0.6)
        axes[axis].set_ylabel(f"error in {label}, px")
        axes[axis].legend(frameon=False, fontsize=8)
    square = np.array([(o.whitened**2).mean() for o in found])
    axes[2].plot(width, square, ".", ms=3, color="#999999", label="frame")
    for low, high in zip((0, *WIDTHS_PX), (*WIDTHS_PX, 10**6), strict=True):
        chosen = (width >= low) & (width < high)
        if chosen.any():
            ends = [width[chosen].min(), width[chosen].max()]
            axes[2].plot(ends, [square[chosen].mean()] * 2, color=COLOURS[0], lw=2.5)
    axes[2].axhline(1.0, color="#000000", linestyle="--", linewidth=1)
    axes[2].set_yscale("log")
    axes[2].set_ylabel("NIS per dof (line: mean of the class)")
    for ax in axes:
        ax.set_xlabel("width of the silhouette, px")
    save(figure, path)


def draw_cost(curves: Mapping[str, tuple[Sequence[float], Sequence[float]]], path: Path) -> None:
    """Draw the time of one segmentation against each quantity, both axes logarithmic."""
    figure, axes = blank(1, len(curves), (4.5 * len(curves), 3.4))
    for k, (ax, (name, (amount, ms))) in enumerate(zip(axes, curves.items(), strict=True)):
        exponent, offset = np.polyfit(np.log(amount), np.log(ms), 1)
        ax.loglog(amount, ms, MARKERS[k], color=COLOURS[k])
        fitted = np.exp(offset) * np.array(amount) ** exponent
        ax.loglog(amount, fitted, color=COLOURS[k], lw=1, label=f"exponent {exponent:.2f}")
        ax.set_xlabel(name)
        ax.set_ylabel("ms per segmentation")
        ax.legend(frameon=False, fontsize=8)
    save(figure, path)
