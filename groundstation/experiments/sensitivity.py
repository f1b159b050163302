"""The ground paper's figure 12: what 0 to 50 px of detection error do to x, y and z."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.experiments import detection_plots as plots
from groundstation.experiments.detection_set_up import SEED
from groundstation.experiments.experiment import Findings, PaperFigure
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.geometry.aim import aim_at
from groundstation.tracking.config import Config

ERRORS_PX = (0, 5, 10, 20, 30, 40, 50)
_DIRECTIONS = {"u and v": (1.0, 1.0), "u": (1.0, 0.0), "v": (0.0, 1.0)}
_PANELS = {"u and v": "(a) u and v", "u": "(b) u, v constant", "v": "(c) v, u constant"}
_PLACES = 40


def sensitivity(recorded: TruthSession) -> Findings:
    """Errors in x, y and z against the error put into the pixels, in u, in v and in both (figure 12)."""
    bias = {name: [_biased(recorded, px * np.array(d)) for px in ERRORS_PX] for name, d in _DIRECTIONS.items()}
    rows: list[list[Cell]] = []
    for name, direction in _DIRECTIONS.items():
        for px, off in zip(ERRORS_PX, bias[name], strict=True):
            filtered, single = _noisy(recorded, px * np.array(direction))
            rows.append([_PANELS[name], px, *off, *single, *filtered])
    table = ResultTable(
        name="sensitivity",
        title="Figure 12: root mean square error by the error of detection",
        columns=(
            *("panel", "px"),
            *("left camera off: CV_T x m", "y m", "z m"),
            *("both noisy: CV_T x m", "y m", "z m"),
            *("both noisy: EKF x m", "y m", "z m"),
        ),
        rows=rows,
        notes=(
            "Left camera off: its pixel is moved by so much, the right one's is exact, heads aimed at the aircraft, at "
            "places along the recorded path. Both noisy: true pixels with white noise of that sigma (seeded) and the "
            "recorded encoder readings, EKF tuned to it; the row of 0 px holds what the encoders alone do.",
            "The paper: errors in y are clearly the highest, since the baseline is much shorter than the runway. Its "
            "figure has no numbers in the text that we have.",
        ),
    )
    figure = PaperFigure(
        name="sensitivity",
        title="Figure 12: what errors of detection do",
        caption="One panel for each direction of the error, the left camera's pixel being off.",
        draw=lambda path: _draw(bias, path),
    )
    differences = (
        "The paper does not say whether one camera's pixel or both are off, nor where; we take one camera, and the rms "
        "over the recorded path. Both off alike would move x and z only.",
        "The constant part in panels (b) and (c) is 0 px here.",
    )
    return Findings(tables=(table,), figures=(figure,), differences=differences)


def _biased(recorded: TruthSession, off_px: FloatArray) -> list[float]:
    """Return the rms error in x, y and z of the midpoint with the first station's pixel off by ``off_px`` (2,)."""
    t = recorded.truth.t_s[recorded.inside(recorded.truth.t_s)]
    places = recorded.truth_at(t[:: max(1, len(t) // _PLACES)])
    errors = []
    for place in places:
        views = []
        for k, station in enumerate(recorded.session.rig.stations[:2]):
            geometry = station.geometry()
            aim = aim_at(geometry, place)
            seen = None if aim is None else geometry.project(place, aim.pan_rad, aim.tilt_rad)
            if aim is None or seen is None:
                continue
            pixel = seen.pixel + (off_px if k == 0 else 0.0)
            views.append(
                TriangulationView(
                    station=geometry,
                    pixel=pixel,
                    covariance_px2=np.eye(2),
                    pan_rad=aim.pan_rad,
                    tilt_rad=aim.tilt_rad,
                    angle_sigma_rad=0.0,
                )
            )
        found = triangulate(views) if len(views) == 2 else None
        if found is not None:
            errors.append(found.midpoint_runway_m - place)
    return _rms(np.array(errors).reshape(-1, 3))


def _noisy(recorded: TruthSession, sigma_px: FloatArray) -> tuple[list[float], list[float]]:
    """Return the rms errors of the EKF and of the midpoint over true pixels with noise of sigma (2,)."""
    pixels = {}
    for k, (name, rows) in enumerate(recorded.true_pixels.items()):
        draw = np.random.default_rng([SEED, k]).normal(size=(len(rows), 2))
        pixels[name] = np.column_stack([rows[:, 0], rows[:, 1:] + draw * sigma_px])
    config = Config()
    tuning = replace(
        config.estimation,
        labelled_sigma_px=max(1.0, float(sigma_px.max())),
        residual_gate_sigma=1e6,
        lost_sigma_m=1e6,
        lost_sigma_px=1e6,
    )
    epochs = recorded.follow(pixels, replace(config, estimation=tuning)).epochs()
    truth = recorded.truth_at(epochs["t_s"])
    errors = [epochs[field].astype(np.float64) - truth for field in ("position_m", "midpoint_m")]
    both = np.isfinite(np.hstack(errors)).all(axis=1)
    return _rms(errors[0][both]), _rms(errors[1][both])


def _rms(errors_m: FloatArray) -> list[float]:
    return [float(v) for v in np.sqrt((errors_m**2).mean(axis=0))] if len(errors_m) else [float("nan")] * 3


def _draw(bias: dict[str, list[list[float]]], path: Path) -> None:
    figure, panels = plots.blank(1, 3, (11.0, 3.8))
    for ax, (name, rows) in zip(panels, bias.items(), strict=True):
        values = np.array(rows)
        for axis, label in enumerate("xyz"):
            ax.plot(ERRORS_PX, values[:, axis], plots.MARKERS[axis], ls="-", color=plots.COLOURS[axis], label=label)
        ax.set_title(_PANELS[name], fontsize=10)
        ax.set_xlabel("error of detection, px")
        ax.set_ylabel("rms error, m")
        ax.legend(frameon=False, fontsize=8)
    plots.save(figure, path)
