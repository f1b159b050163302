"""The ground paper's section 5.1: the region of interest, the detectors, their accuracy, and the tracks they give."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.evaluation.metrics import phase_masks
from groundstation.experiments import detection_plots as plots
from groundstation.experiments import detection_tables as found
from groundstation.experiments.detection_set_up import FULL, OURS, PAPER_METHODS, PAPER_ROI, SWEEP
from groundstation.experiments.detector_outcomes import DetectorOutcome
from groundstation.experiments.experiment import Findings, PaperFigure
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.tracking.config import Config

_TRACED = (OURS, "snake", "GVF snake")
_SAID = {
    OURS: "errors stay small near the ground",
    "snake": "errors grow near the ground",
    "GVF snake": "errors grow near the ground",
}


def roi_sweep(recorded: TruthSession) -> Findings:
    """Time and deviation by the basic size of the region of interest (figure 10, table 1)."""
    sweep = {name: recorded.outcomes[name] for name in SWEEP}
    figure = PaperFigure(
        name="roi_sweep",
        title="Figure 10: time by the size of the region of interest",
        caption="Left: processor time of one picture. Right: how far the point is from that of the full frame.",
        draw=lambda path: plots.draw_roi_sweep(sweep, FULL, path),
    )
    return Findings(tables=(found.roi_table(sweep, FULL, PAPER_ROI),), figures=(figure,))


def methods(recorded: TruthSession) -> Findings:
    """Chan-Vese against snake and GVF snake: time, errors, failures (figures 7 and 9, table 2)."""
    compared = recorded.methods
    figure = PaperFigure(
        name="methods",
        title="Figures 7 and 9, table 2: Chan-Vese against the snakes",
        caption="Overlap with the true silhouette and error of the point, left camera; times of all pictures.",
        draw=lambda path: plots.draw_methods(compared, path),
    )
    return Findings(
        tables=(found.method_table(compared, PAPER_METHODS), found.failure_table(compared)), figures=(figure,)
    )


def accuracy_by_phase(recorded: TruthSession) -> Findings:
    """The detector's error by size and by background (text of section 5.1)."""
    outcomes = recorded.methods[OURS]
    figure = PaperFigure(
        name="detector_accuracy",
        title="The detector's error by the silhouette's width",
        caption="Each picture's error in u and in v, and its square over the stated covariance.",
        draw=lambda path: plots.draw_accuracy(outcomes, path),
    )
    return Findings(
        tables=(found.accuracy_table(outcomes),),
        figures=(figure,),
        differences=("The paper gives no such table: it shows single pictures and the tracks that come of them.",),
    )


def trajectories(recorded: TruthSession) -> Findings:
    """GVF, snake and Chan-Vese through one triangulation (figure 8)."""
    tracks = {name: _triangulated(recorded, recorded.methods[name]) for name in _TRACED}
    errors = {name: rows[:, 1:] - recorded.truth_at(rows[:, 0]) for name, rows in tracks.items()}
    pairs = len({o.t_s for o in recorded.methods[OURS]})
    rows: list[list[Cell]] = []
    for phase, inside in {"all": None, **_phases(recorded)}.items():
        for name in _TRACED:
            kept = _in(tracks[name][:, 0], inside)
            if not kept.any() and phase != "all":
                continue
            e = errors[name][kept]
            rms: list[Cell] = [None, None, None]
            if len(e):
                rms = [float(v) for v in np.sqrt((e**2).mean(axis=0))]
            middle: list[Cell] = [float(v) for v in np.median(np.abs(e), axis=0)] if len(e) else [None] * 3
            reported = _SAID[name] if phase == "all" else ""
            rows.append([phase, name, len(e), *rms, *middle, reported])
    table = ResultTable(
        name="trajectories",
        title="Figure 8: one triangulation of three detectors' points",
        columns=(
            *("background", "detector", "points", "RMSE x m", "y m", "z m"),
            *("median error x m", "y m", "z m", "paper"),
        ),
        rows=rows,
        notes=(
            f"Of {pairs} pairs. Midpoint of the common perpendicular (the paper's CV_T), errors against the exact "
            "trajectory. A pair enters where both cameras gave a point; the paper's figure has no numbers.",
        ),
    )
    figure = PaperFigure(
        name="trajectories",
        title="Figure 8: trajectories by GVF, snake and Chan-Vese",
        caption="Triangulated points seen from above and from the side, with the exact trajectory.",
        draw=lambda path: _draw_trajectories(recorded, tracks, path),
    )
    differences = (
        "The paper takes the point from the region alone; here the nose is measured in the picture inside the region's "
        "box, so a poor region mostly costs points rather than accuracy.",
        "Predictions of the region of interest are the truth with 4 px of noise, the same for all three.",
        "The reference is the exact trajectory, the paper's is DGPS.",
    )
    return Findings(tables=(table,), figures=(figure,), differences=differences)


def _triangulated(recorded: TruthSession, outcomes: list[DetectorOutcome]) -> FloatArray:
    """Return time and midpoint (n, 4) of the pairs in which both cameras found a point."""
    pixels = {
        name: np.array([(o.t_s, *o.point_px) for o in outcomes if o.station == name and o.found]).reshape(-1, 3)
        for name in recorded.session.rig.names
    }
    if any(len(rows) == 0 for rows in pixels.values()):
        return np.zeros((0, 4))
    epochs = recorded.follow(pixels, Config()).epochs()
    kept = epochs[np.isfinite(epochs["midpoint_m"]).all(axis=1)]
    return np.column_stack([kept["t_s"], kept["midpoint_m"].astype(np.float64)])


def _phases(recorded: TruthSession) -> dict[str, tuple[float, float]]:
    """Return each background's first and last time."""
    t = recorded.truth.t_s
    spans = {}
    for name, inside in phase_masks(t, recorded.session.phases).items():
        if inside.any():
            spans[name] = (float(t[inside].min()), float(t[inside].max()))
    return spans


def _in(t_s: FloatArray, span: tuple[float, float] | None) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    if span is None:
        return np.ones(len(t_s), dtype=np.bool_)
    return (t_s >= span[0] - 1e-6) & (t_s <= span[1] + 1e-6)


def _draw_trajectories(recorded: TruthSession, tracks: Mapping[str, FloatArray], path: Path) -> None:
    """Draw x and z over y."""
    figure, panels = plots.blank(2, 1, (9.0, 7.0))
    truth = recorded.truth.position_runway_m[recorded.inside(recorded.truth.t_s)]
    for ax, axis, label in zip(panels, (0, 2), "xz", strict=True):
        for k, (name, rows) in enumerate(tracks.items()):
            ax.plot(
                rows[:, 2], rows[:, 1 + axis], plots.MARKERS[k], ms=3, color=plots.COLOURS[k], label=name, alpha=0.7
            )
        ax.plot(truth[:, 1], truth[:, axis], color="#000000", lw=1.0, label="exact")
        low, high = truth[:, axis].min(), truth[:, axis].max()
        room = max(0.3 * (high - low), 0.5)
        ax.set_ylim(low - room, high + room)
        ax.set_ylabel(f"{label} in m")
    panels[-1].set_xlabel("y in m")
    panels[0].legend(frameon=False, fontsize=8, ncols=4)
    plots.save(figure, path)
