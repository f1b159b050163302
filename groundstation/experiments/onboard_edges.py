"""The runway-edge paper's table 1 and figure 15 on rendered approaches with exact truth."""

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray
from groundstation.experiments import detection_plots as plots
from groundstation.experiments.experiment import Findings, PaperFigure
from groundstation.experiments.onboard_pictures import panel, sheet
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.onboard.edges.baselines import hough_edges
from groundstation.onboard.edges.config import TrackerConfig, paper_config
from groundstation.onboard.edges.gradient_descent import Energy
from groundstation.onboard.edges.kalman import picture_crossings, picture_state, predict_picture, update_picture
from groundstation.onboard.edges.lines import crossings_at, line_map, project_lines
from groundstation.onboard.edges.pose import NoseCameraPose, intrinsic_matrix
from groundstation.onboard.edges.search_band import NoBand, RunwayGuess, band_rows
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.scenes.sequences import NOSE_LENS, SEQUENCES, NoseFrame, Renderer, Sequence

FRAMES = 50
HZ = 10.0
KAPPA = intrinsic_matrix(NOSE_LENS)
GUESS = RunwayGuess(width_m=20.0, length_m=500.0)
# an error counts as at most this: a line that is off the picture is lost, however far
LOST_PX = 200.0
_OURS, _VARIANT, _FLAT, _HOUGH = "ours", "spatially variant", "non-variant", "Hough and Canny"
# the paper's table 1: mean and spread of the three methods, px
_PAPERS = (("paper's 1", 6.9, 3.6, 30.9, 24.5, 54.3, 99.4), ("paper's 2", 7.3, 2.9, 32.9, 22.6, 57.9, 39.9))
SEED_STEP = 7000
_SHOWN = (0, 25, 45)
TRUE_COLOUR = (60, 60, 255)
_COLOURS = {_OURS: (80, 255, 80), _VARIANT: (255, 160, 60), _HOUGH: (60, 200, 255)}
DIFFERENCES = (
    "The paper's two sequences are of a flight simulator and are not published; ours are rendered, 50 frames each, one "
    "for each light, with exact truth, and with taxiways and roads next to the runway.",
    "“Spatially variant” and “non-variant” are the paper's tracker with either energy, started by Algorithm 1; a frame "
    "without edges counts with the last edges that there were.",
)

Found = tuple[FloatArray, FloatArray] | None
Step = Callable[[NoseFrame], Found]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Tracked:
    """One sequence: its frames, the errors (n, 4) px and outcomes of each method, and frames without edges."""

    sequence: Sequence
    frames: list[NoseFrame]
    errors: dict[str, FloatArray]
    found: dict[str, list[Found]]


def edges(recorded: TruthSession) -> Findings:
    """Edges in four lights: this tracker, the paper's with both energies, and Hough on Canny."""
    count = round(recorded.at_most_s(FRAMES / HZ) * HZ)
    tracked = [_track(replace(s, seed=s.seed + SEED_STEP), count) for s in SEQUENCES[:4]]
    rows: list[list[Cell]] = []
    for one in tracked:
        rows.append([one.sequence.name, len(one.frames), *_rms_and_spread(one.errors)])
    pooled = {name: np.concatenate([one.errors[name] for one in tracked]) for name in tracked[0].errors}
    rows.append(["all", count * len(tracked), *_rms_and_spread(pooled)])
    rows += [[number, 50, None, None, *cells] for number, *cells in _PAPERS]
    numbers: list[list[Cell]] = []
    for one in tracked:
        for name, own in one.errors.items():
            missing = sum(found is None for found in one.found[name])
            rms, median = float(np.sqrt(np.mean(own**2))), float(np.median(np.abs(own)))
            numbers.append([one.sequence.name, name, rms, median, missing])
    tables = (
        ResultTable(
            name="runway_edges",
            title="Table 1: error of the runway's edges in px, root mean square ± spread over the frames",
            columns=("sequence", "frames", _OURS, "±", _VARIANT, "± ", _FLAT, "±  ", _HOUGH, "±   "),
            rows=rows,
            notes=("The four ends of both edges, where they are visible by the truth.",),
        ),
        ResultTable(
            name="runway_edges_numbers",
            title="The same with medians, and frames without edges",
            columns=("sequence", "method", "rms px", "median px", "without"),
            rows=numbers,
        ),
    )
    figure = PaperFigure(
        name="runway_edges",
        title="Figures 13 and 14: edges followed",
        caption="Each light at three moments, cut out about the runway: truth red, ours green, the paper's tracker "
        "(spatially variant) blue, Hough and Canny yellow. A line that is not seen lies outside what is cut out, or "
        "there is none.",
        draw=lambda path: _draw(tracked, path),
    )
    return Findings(tables=tables, figures=(figure,), differences=DIFFERENCES)


def _rms_and_spread(errors: Mapping[str, FloatArray]) -> list[Cell]:
    """Return each method's root mean square and the spread of the frames', px."""
    cells: list[Cell] = []
    for name in (_OURS, _VARIANT, _FLAT, _HOUGH):
        per_frame = np.sqrt(np.mean(errors[name] ** 2, axis=1))
        cells += [float(np.sqrt(np.mean(errors[name] ** 2))), float(per_frame.std())]
    return cells


def true_edges(sequence: Sequence, pose: NoseCameraPose) -> tuple[FloatArray, FloatArray]:
    """Return where the true edges cross rows (4,), and the rows (2,) between which they are seen."""
    field = sequence.airfield
    guess = RunwayGuess(width_m=field.width_m, length_m=field.length_m, margin_m=0.5, margin_px=0.0)
    rows = band_rows(pose, KAPPA, NOSE_LENS.image_size_px, guess)
    if isinstance(rows, NoBand):
        rows = np.array([240.0, 300.0])
    lines = np.array([1.0, 0.0, -0.5 * field.width_m, 0.5 * field.width_m])
    return project_lines(lines, line_map(pose, KAPPA), rows)[0], rows


def _tracker(config: TrackerConfig) -> Step:
    tracker = EdgeTracker(KAPPA, NOSE_LENS.image_size_px, config)

    def step(frame: NoseFrame) -> Found:
        found = tracker.step(frame.image, frame.reported).edges
        return None if found is None else (found.crossings_px, found.rows_px)

    return step


def rows_said(frame: NoseFrame) -> FloatArray | None:
    """Return the rows (2,) of the search band by the sensors' pose; None where no edge is expected."""
    rows = band_rows(frame.reported, KAPPA, NOSE_LENS.image_size_px, GUESS)
    return None if isinstance(rows, NoBand) else rows


def hough(frame: NoseFrame) -> Found:
    """Return Hough's lines on Canny's edges in the rows that the sensors' pose predicts."""
    rows = rows_said(frame)
    found = None if rows is None else hough_edges(frame.image, rows)
    return None if found is None or rows is None else (found, rows)


def _track(sequence: Sequence, count: int) -> _Tracked:
    """Run every method over a sequence."""
    frames = rendered(sequence, count)
    steps: dict[str, Step] = {
        _OURS: _tracker(TrackerConfig(guess=GUESS)),
        _VARIANT: _tracker(paper_config(GUESS)),
        _FLAT: _tracker(paper_config(GUESS, Energy.NON_VARIANT)),
        _HOUGH: hough,
    }
    errors, everything = {}, {}
    for name, step in steps.items():
        own, all_found, last = [], [], None
        for frame in frames:
            found = step(frame)
            last = found or last
            wanted, rows = true_edges(sequence, frame.truth)
            off = np.full(4, LOST_PX) if last is None else crossings_at(*last, rows) - wanted
            own.append(np.clip(off, -LOST_PX, LOST_PX))
            all_found.append(found)
        errors[name], everything[name] = np.array(own), all_found
    return _Tracked(sequence=sequence, frames=frames, errors=errors, found=everything)


@functools.lru_cache(maxsize=4)
def rendered(sequence: Sequence, count: int) -> list[NoseFrame]:
    """Return the first pictures of a sequence; rendered once for all experiments that use them."""
    renderer = Renderer(replace(sequence, approach=replace(sequence.approach, frames=count)))
    return list(renderer.frames())


def _draw(tracked: list[_Tracked], path: Path) -> None:
    """Draw the runway's part of the pictures side by side."""
    sheets = []
    for one in tracked:
        row = []
        for k in sorted({min(k, len(one.frames) - 1) for k in _SHOWN} | {0}):
            frame = one.frames[k]
            wanted, rows = true_edges(one.sequence, frame.truth)
            drawn = [(TRUE_COLOUR, wanted)]
            for name, colour in _COLOURS.items():
                found = one.found[name][k]
                if found is not None:
                    drawn.append((colour, crossings_at(*found, rows)))
            row.append(panel(frame.image, wanted, rows, drawn, f"{one.sequence.name}, frame {k + 1}"))
        sheets.append(row)
    legend = [(TRUE_COLOUR, "truth"), *((colour, name) for name, colour in _COLOURS.items())]
    cv2.imwrite(str(path), sheet(sheets, legend))


# --------------------------------------------------------------------------------------- prediction alone
_THREE, _TWO, _HELD = "3-D model, IMU", "2-D model, constant velocity", "2-D, held"


def prediction(recorded: TruthSession) -> Findings:
    """Predictions that no picture corrects: the 3-D model against the 2-D ones (figure 15)."""
    count = round(recorded.at_most_s(FRAMES / HZ) * HZ)
    before = min(10, count // 2)
    curves: dict[str, list[FloatArray]] = {_THREE: [], _TWO: [], _HELD: []}
    for sequence in SEQUENCES[:4]:
        for name, own in _predicted(replace(sequence, seed=sequence.seed + SEED_STEP), count, before).items():
            curves[name].append(own)
    means = {name: np.sqrt(np.mean(np.array(own) ** 2, axis=0)) for name, own in curves.items()}
    moments = sorted({min(k, count - before - 1) for k in (5, 10, 20, 39)})
    rows: list[list[Cell]] = [[name, *(float(curve[k]) for k in moments)] for name, curve in means.items()]
    table = ResultTable(
        name="edge_prediction",
        title="Figure 15: edges without a measurement, root mean square error in px",
        columns=("model", *(f"after {k / HZ:g} s" for k in moments)),
        rows=rows,
        notes=(
            "Over four lights. Both models are given the true edges until then; the IMU's lasting errors are known.",
        ),
    )
    figure = PaperFigure(
        name="edge_prediction",
        title="Figure 15: 3-D and 2-D tracking models",
        caption="Error of the predicted edges over time without a measurement.",
        draw=lambda path: _draw_prediction(means, path),
    )
    text = (
        "The paper's figure shows two sequences with measurements; ours leaves them out, which is what the models do."
    )
    return Findings(tables=(table,), figures=(figure,), differences=(DIFFERENCES[0], text))


def _predicted(sequence: Sequence, count: int, before: int) -> dict[str, FloatArray]:
    """Return the root mean square error (count − before,) of each model; poses are enough, no picture is rendered."""
    renderer = Renderer(replace(sequence, approach=replace(sequence.approach, frames=count)))
    truths = [renderer.pose(k) for k in range(count)]
    reported = [renderer.pose(k, renderer.reported) for k in range(count)]
    field = sequence.airfield
    lines = np.array([1.0, 0.0, -0.5 * field.width_m, 0.5 * field.width_m])
    turn = reported[before].threshold_from_camera.T @ truths[before].threshold_from_camera
    shift = truths[before].camera_threshold_m - reported[before].camera_threshold_m
    wanted, rows = true_edges(sequence, truths[0])
    flat, held = picture_state(wanted, rows, 240.0, np.array([100.0, 1.0])), (wanted, rows)
    found: dict[str, list[float]] = {_THREE: [], _TWO: [], _HELD: []}
    for k, true in enumerate(truths):
        wanted, rows = true_edges(sequence, true)
        if k:
            flat = predict_picture(flat, 1.0 / HZ, np.array([500.0, 0.05]))
        if k <= before:
            flat = update_picture(flat, wanted, rows, 0.01 * np.eye(4))
            held = wanted, rows
        if k < before:
            continue
        imu = NoseCameraPose(
            threshold_from_camera=reported[k].threshold_from_camera @ turn,
            camera_threshold_m=reported[k].camera_threshold_m + shift,
        )
        for name, crossings in (
            (_THREE, project_lines(lines, line_map(imu, KAPPA), rows)[0]),
            (_TWO, picture_crossings(flat, rows)),
            (_HELD, crossings_at(*held, rows)),
        ):
            off = np.clip(crossings - wanted, -LOST_PX, LOST_PX)
            found[name].append(math.sqrt(float(np.mean(off**2))))
    return {name: np.array(values) for name, values in found.items()}


def _draw_prediction(means: dict[str, FloatArray], path: Path) -> None:
    figure, (ax,) = plots.blank(1, 1, (6.5, 3.6))
    for k, (name, curve) in enumerate(means.items()):
        ax.semilogy(np.arange(len(curve)) / HZ, np.maximum(curve, 1e-2), color=plots.COLOURS[k], label=name)
    ax.set_xlabel("s without a measurement")
    ax.set_ylabel("edges, px")
    ax.legend(frameon=False, fontsize=8)
    plots.save(figure, path)
