"""Runway edges in rendered approaches: errors in px against truth, with distractors, in five lights; times; figures.

    python benchmarks/onboard_edges.py [--out DIR] [--draws N] [--first SEED] [--only ours,hough,…] [--quick]

1. RMSE of the four ends of both edges, of the tracker, the paper's energies and the two baselines (the paper's
   Table 1), in N airfields drawn for each light; `--draws 0` takes the sequences' own, which the tracker was tuned on.
   Of ours also the share of frames beyond 10 px, and of those that say they track all the same.
1b. The energies alone: down from lines 2, 4 and 8 px off, in bands across the runway and along the normals.
2. Prediction alone: the 3-D model, with an IMU or the pictures' motion, and constant velocity in the picture (Fig. 15).
3. Processor time of a frame, and over that of OpenCV's Canny with HoughLines in the same run; of ours also what
   frames of tracking, the first and the others take, and how many are within 5 ms.
4. Pictures with the edges drawn.
"""

import argparse
import csv
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray

from groundstation.onboard.edges.baselines import graph_cut_edges, hough_edges
from groundstation.onboard.edges.config import TrackerConfig, paper_config
from groundstation.onboard.edges.descent import DescentConfig, Energy, descend
from groundstation.onboard.edges.kalman import picture_crossings, picture_state, predict_picture, update_picture
from groundstation.onboard.edges.lines import crossings_at, line_map, project_lines, shifted
from groundstation.onboard.edges.motion import VisualOdometry
from groundstation.onboard.edges.pose import CameraPose, intrinsic_matrix
from groundstation.onboard.edges.report import EdgeReport, EdgeStatus
from groundstation.onboard.edges.search_band import NoBand, RunwayGuess, across_direction, band_rows, band_widths
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.scenes.sequences import NOSE_LENS, SEQUENCES, NoseFrame, Renderer, Sequence, varied

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parent.parent
KAPPA = intrinsic_matrix(NOSE_LENS)
SIZE = NOSE_LENS.image_size_px
GUESS = RunwayGuess(width_m=20.0, length_m=500.0)
OPENCV = "cv2.Canny + cv2.HoughLines, whole picture"
BOUND_MS = 5.0  # of a frame's processor time, what is wanted
CHI2_999 = 18.47  # 4 degrees of freedom
LOST_PX = 200.0  # an error is counted as at most this: a line that is off the picture is lost, however far
SHOWN = (0, 30, 59)
Array = NDArray[np.float64]
Step = Callable[[NoseFrame], tuple[Array, Array] | None]


def truth(sequence: Sequence, pose: CameraPose) -> tuple[Array, Array]:
    """Return the rows (2,) between which the true edges are seen, and where they cross them (4,)."""
    field = sequence.airfield
    guess = RunwayGuess(width_m=field.width_m, length_m=field.length_m, margin_m=0.5, margin_px=0.0)
    rows = band_rows(pose, KAPPA, SIZE, guess)
    if isinstance(rows, NoBand):
        raise ValueError(f"{sequence.name}: {rows.value}")
    lines = np.array([1.0, 0.0, -0.5 * field.width_m, 0.5 * field.width_m])
    return rows, project_lines(lines, line_map(pose, KAPPA), rows)[0]


def tracked(config: TrackerConfig, reports: list[EdgeReport] | None = None) -> Step:
    """Return a tracker as a step that gives crossings and their rows; what it says goes to ``reports``."""
    tracker = EdgeTracker(KAPPA, SIZE, config)

    def step(frame: NoseFrame) -> tuple[Array, Array] | None:
        report = tracker.step(frame.image, frame.said)
        edges = report.edges
        if reports is not None:
            reports.append(report)
        return None if edges is None else (edges.crossings_px, edges.rows_px)

    return step


def plain(energy: Energy) -> TrackerConfig:
    """Return our filter with nothing but a descent from its prediction, in bands across: what sets energies apart."""
    descent = DescentConfig(energy=energy)
    config = TrackerConfig(guess=GUESS, use_strip=False, profile=None, paint_m=0.0, band_m=4.0, gate=math.inf)
    return replace(config, descent=descent)


def from_last(sequence: Sequence, first: CameraPose, energy: Energy) -> Step:
    """Return the paper's segmentation alone, from where the last frame's ended; the first starts at the truth."""
    rows, last = truth(sequence, first)
    config = DescentConfig(energy=energy, gamma=1e-3, adaptive_gamma=False)

    def step(frame: NoseFrame) -> tuple[Array, Array] | None:
        nonlocal rows, last
        now = rows_said(frame)
        if now is None:
            return None
        crossings = crossings_at(last, rows, now)
        widths = np.repeat(band_px(frame, now)[None, :], 2, axis=0)
        last, rows = descend(frame.image, crossings, now, widths, config).crossings_px, now
        return last, rows

    return step


def rows_said(frame: NoseFrame) -> Array | None:
    """Return the rows of the search band by what the sensors say."""
    rows = band_rows(frame.said, KAPPA, SIZE, GUESS)
    return None if isinstance(rows, NoBand) else rows


def band_px(frame: NoseFrame, rows: Array) -> Array:
    """Return how wide 4 m are at both rows (2,), along the row."""
    e, lines = line_map(frame.said, KAPPA), np.array([1.0, 0.0, -10.0, 10.0])
    inner, outer = project_lines(lines, e, rows)[0], project_lines(shifted(lines, 4.0), e, rows)[0]
    return np.maximum(np.abs(outer - inner)[:2], 2.5)


def hough(frame: NoseFrame) -> tuple[Array, Array] | None:
    """Return the baseline's edges."""
    rows = rows_said(frame)
    found = None if rows is None else hough_edges(frame.image, rows)
    return None if rows is None or found is None else (found, rows)


def graph_cut(frame: NoseFrame) -> tuple[Array, Array] | None:
    """Return GrabCut's edges, seeded by the nominal runway from the sensors' pose."""
    rows = rows_said(frame)
    if rows is None:
        return None
    e, lines = line_map(frame.said, KAPPA), np.array([1.0, 0.0, -10.0, 10.0])
    guess, outer = project_lines(lines, e, rows)[0], project_lines(shifted(lines, 4.0), e, rows)[0]
    found = graph_cut_edges(frame.image, rows, guess, band_widths(guess, outer, rows, 2.5))
    return None if found is None else (found, rows)


def methods(sequence: Sequence, first: CameraPose, reports: list[EdgeReport] | None = None) -> dict[str, Step]:
    """Return everything that is compared, ready for a sequence."""
    printed, flat = paper_config(GUESS), paper_config(GUESS, Energy.NON_VARIANT)
    return {
        "ours": tracked(TrackerConfig(guess=GUESS), reports),
        "spatially variant, KF": tracked(printed),
        "non-variant, KF": tracked(flat),
        "spatially variant, our filter": tracked(plain(Energy.SPATIALLY_VARIANT)),
        "non-variant, our filter": tracked(plain(Energy.NON_VARIANT)),
        "spatially variant, last frame": from_last(sequence, first, Energy.AS_PRINTED),
        "non-variant, last frame": from_last(sequence, first, Energy.NON_VARIANT),
        "Hough and Canny": hough,
        "GrabCut": graph_cut,
    }


def measure(
    sequence: Sequence, frames: list[NoseFrame], only: list[str], reports: list[EdgeReport]
) -> tuple[dict[str, Array], dict[str, Array], dict[str, int]]:
    """Return of each method the errors (n, 4) px, processor times (n,) s, and frames without edges.

    A frame without edges counts with the last edges that there were, as one would have to fly on them.
    """
    errors, times, without = {}, {}, {}
    for name, step in methods(sequence, frames[0].truth, reports).items():
        if only and not any(word in name.lower() for word in only):
            continue
        own, spent, last, missing = [], [], None, 0
        for frame in frames:
            started = time.thread_time()
            found = step(frame)
            spent.append(time.thread_time() - started)
            missing += found is None
            last = found or last
            rows, wanted = truth(sequence, frame.truth)
            if last is not None:
                own.append(np.clip(crossings_at(last[0], last[1], rows) - wanted, -LOST_PX, LOST_PX))
            else:
                own.append(np.full(4, LOST_PX))
        errors[name], times[name], without[name] = np.array(own), np.array(spent), missing
    return errors, times, without


def normalised(sequence: Sequence, frame: NoseFrame, report: EdgeReport) -> float:
    """Return the squared error of ours over its covariance, at its own rows, of 4; NaN without edges."""
    if report.edges is None:
        return math.nan
    rows, wanted = truth(sequence, frame.truth)
    e = report.edges.crossings_px - crossings_at(wanted, rows, report.edges.rows_px)
    return float(e @ np.linalg.solve(report.edges.covariance_px2, e))


def energies_alone(sequence: Sequence, frames: list[NoseFrame]) -> dict[tuple[str, float], Array]:
    """Return errors (n, 4) px after going down from lines that are off by 2, 4 and 8 px, of every third frame."""
    found: dict[tuple[str, float], list[Array]] = {}
    for off_px in (2.0, 4.0, 8.0):
        draw_off = np.random.default_rng([sequence.seed, int(off_px)])
        for frame in frames[::3]:
            rows, wanted = truth(sequence, frame.truth)
            start = wanted + np.repeat(draw_off.normal(0.0, off_px, 2), 2) + draw_off.normal(0.0, 1.0, 4)
            if min(start[2] - start[0], start[3] - start[1]) < 3.0:
                continue
            widths = np.repeat(band_px(frame, rows)[None, :], 2, axis=0)
            across = across_direction(line_map(frame.said, KAPPA))
            for name, energy, along in (
                ("variant, bands across", Energy.SPATIALLY_VARIANT, across),
                ("variant, normals", Energy.SPATIALLY_VARIANT, None),
                ("non-variant", Energy.NON_VARIANT, None),
            ):
                config = DescentConfig(energy=energy, gamma=1e-3, adaptive_gamma=False)
                end = descend(frame.image, start, rows, widths, config, along).crossings_px
                found.setdefault((name, off_px), []).append(np.clip(end - wanted, -LOST_PX, LOST_PX))
    return {key: np.array(values) for key, values in found.items()}


def prediction(sequence: Sequence, frames: list[NoseFrame]) -> dict[str, Array]:
    """Return the RMSE (n,) px of predictions that no measurement corrects after the first second."""
    start = round(sequence.approach.rate_hz)
    field = sequence.airfield
    lines = np.array([1.0, 0.0, -0.5 * field.width_m, 0.5 * field.width_m])
    rows, crossings = truth(sequence, frames[0].truth)
    flat = picture_state(crossings, rows, 240.0, np.array([100.0, 1.0]))
    odometry = VisualOdometry(KAPPA, frames[start].truth)
    found: dict[str, list[float]] = {"3-D, IMU": [], "3-D, pictures": [], "2-D, constant velocity": [], "2-D, held": []}
    held = crossings, rows
    # the IMU's lasting errors are known from the tracked second before: what is compared is what comes after
    turn = frames[start].said.threshold_from_camera.T @ frames[start].truth.threshold_from_camera
    shift = frames[start].truth.camera_threshold_m - frames[start].said.camera_threshold_m
    for k, frame in enumerate(frames):
        rows, wanted = truth(sequence, frame.truth)
        if k:
            flat = predict_picture(flat, frame.t_s - frames[k - 1].t_s, np.array([500.0, 0.05]))
        if k <= start:
            flat = update_picture(flat, wanted, rows, 0.01 * np.eye(4))
            held = wanted, rows
        if k < start:
            continue
        imu = CameraPose(
            threshold_from_camera=frame.said.threshold_from_camera @ turn,
            camera_threshold_m=frame.said.camera_threshold_m + shift,
        )
        seen = odometry.step(frame.image)
        for name, crossings in (
            ("3-D, IMU", project_lines(lines, line_map(imu, KAPPA), rows)[0]),
            ("3-D, pictures", project_lines(lines, line_map(seen, KAPPA), rows)[0]),
            ("2-D, constant velocity", picture_crossings(flat, rows)),
            ("2-D, held", crossings_at(*held, rows)),
        ):
            off = np.clip(crossings - wanted, -LOST_PX, LOST_PX)
            found[name].append(float(np.sqrt(np.mean(off**2))))
    return {name: np.array(values) for name, values in found.items()}


def opencv_time(frames: list[NoseFrame]) -> Array:
    """Return the processor time (n,) s of Canny and HoughLines on whole pictures, the usual call."""
    spent = []
    for frame in frames:
        started = time.thread_time()
        edges = cv2.Canny(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), 50, 150)
        cv2.HoughLines(edges, 1.0, math.radians(1.0), 80)
        spent.append(time.thread_time() - started)
    return np.array(spent)


def draw(sequence: Sequence, frames: list[NoseFrame]) -> NDArray[np.uint8]:
    """Return frames side by side: the truth red, ours green, the paper's blue."""
    colours = {"ours": (80, 255, 80), "spatially variant, KF": (255, 160, 60)}
    steps = {name: step for name, step in methods(sequence, frames[0].truth).items() if name in colours}
    shown = []
    for frame in frames:
        rows, wanted = truth(sequence, frame.truth)
        lines = [((60, 60, 255), wanted, rows)]
        for name, step in steps.items():
            found = step(frame)
            if found is not None:
                lines.append((colours[name], crossings_at(*found, rows), rows))
        if frame.index in SHOWN:
            picture = frame.image.copy()
            for colour, u, v in lines:
                for k in (0, 2):
                    ends = [(round(16 * float(u[k + i])), round(16 * float(v[i]))) for i in (0, 1)]
                    cv2.line(picture, *ends, colour, 1, cv2.LINE_AA, 4)
            shown.append(picture[120:420])
    return np.hstack(shown)


def draw_predictions(out: Path, predicted: dict[str, list[Array]]) -> None:
    """Print and draw the RMSE of predictions over time."""
    print("prediction alone, RMSE px after 1, 2 and 4 s")
    figure, axes = plt.subplots(figsize=(6.4, 3.6))
    for name, own in predicted.items():
        curve = np.sqrt(np.mean(np.array(own) ** 2, axis=0))
        print(f"{name}: {curve[10]:.1f} {curve[20]:.1f} {curve[40]:.1f}")
        axes.plot(np.arange(curve.size) / 10.0, curve, label=name)
    axes.set(xlabel="s without a measurement", ylabel="RMSE of the edges, px", yscale="log")
    axes.legend()
    figure.tight_layout()
    figure.savefig(out / "prediction.png", dpi=110)


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "onboard-edges")
    parser.add_argument("--draws", type=int, default=2, help="airfields drawn for each light; 0: those tuned on")
    parser.add_argument("--first", type=int, default=100, help="seed of the first")
    parser.add_argument("--only", default="", help="methods whose names hold one of these words, comma between")
    parser.add_argument("--quick", action="store_true", help="leave out the predictions and OpenCV's times")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    only = [word for word in options.only.lower().split(",") if word]
    options.out.mkdir(parents=True, exist_ok=True)
    rows, pooled, predicted, spent, pictures, alone = [], {}, {}, {}, [], {}
    said: dict[str, list[float]] = {"px": [], "tracking": [], "square": [], "ms": [], "first": []}
    for sequence in SEQUENCES:
        for draw_number in range(max(options.draws, 1)):
            drawn = varied(sequence, options.first + draw_number) if options.draws else sequence
            frames = list(Renderer(drawn).frames())
            reports: list[EdgeReport] = []
            errors, times, without = measure(drawn, frames, only, reports)
            for name, own in errors.items():
                per_frame = np.sqrt(np.mean(own**2, axis=1))
                rms = float(np.sqrt(np.mean(own**2)))
                rows.append([sequence.name, drawn.seed, name, rms, float(per_frame.std()), without[name]])
                print(f"{sequence.name} {drawn.seed}: {name}: {rms:.1f} px", flush=True)
                pooled.setdefault(name, []).append(own)
            said["px"] += list(np.sqrt(np.mean(errors["ours"] ** 2, axis=1)))
            said["tracking"] += [float(one.status is EdgeStatus.TRACKING) for one in reports]
            said["square"] += [normalised(drawn, *pair) for pair in zip(frames, reports, strict=True)]
            said["ms"] += list(1e3 * times["ours"])
            said["first"] += [float(frame is frames[0]) for frame in frames]
            for key, own in energies_alone(drawn, frames).items():
                alone.setdefault(key, []).append(own)
            for name, own in times.items():
                spent.setdefault(name, []).append(own[1:])
            if draw_number == 0:
                pictures.append(draw(drawn, frames))
            if not options.quick:
                for name, own in prediction(drawn, frames).items():
                    predicted.setdefault(name, []).append(own)
                spent.setdefault(OPENCV, []).append(opencv_time(frames)[1:])
    report(options.out, rows, pooled, predicted, spent, pictures)
    report_ours({name: np.array(values) for name, values in said.items()})
    for (name, off_px), own in alone.items():
        alls = np.concatenate(own)
        spread = f"{np.sqrt(np.mean(alls**2)):.2f} px, median {np.median(np.abs(alls)):.2f}"
        print(f"energy alone, from {off_px:.0f} px off: {name}: {spread}")


def report_ours(said: dict[str, Array]) -> None:
    """Print how often ours is wrong, and how often it does not say so."""
    tracking, wrong = said["tracking"] > 0.5, said["px"] > 10.0
    print(
        f"ours: {said['px'].size} frames, {np.mean(wrong):.2%} beyond 10 px; says tracking in {np.mean(tracking):.1%}"
    )
    print(f"ours: wrong and confident (tracking, beyond 10 px): {np.mean(wrong & tracking):.2%}")
    square = said["square"][tracking]
    beyond = np.mean(square > CHI2_999)
    print(f"ours: squared error over stated, of 4: mean {np.nanmean(square):.2f}, beyond 99.9 %: {beyond:.2%}")
    report_cost(said["ms"], tracking, said["first"] > 0.5)


def report_cost(ms: Array, tracking: NDArray[np.bool_], first: NDArray[np.bool_]) -> None:
    """Print the processor time (n,) of frames, where it is spent, and how many are within the bound.

    The first frame of an approach is told apart: there everything is looked at. The very first frame of a run is left
    out, as it reads the compiled code.
    """
    ms, tracking, first = ms[1:], tracking[1:], first[1:]
    for name, part in (
        ("all", np.ones(ms.size, bool)),
        ("tracking", tracking),
        ("first of an approach", first),
        ("acquiring and others", ~tracking & ~first),
    ):
        if part.any():
            own = ms[part]
            spread = f"median {np.median(own):.2f} ms, 99 % {np.percentile(own, 99):.2f}, at most {own.max():.2f}"
            within = f"{np.mean(own <= BOUND_MS):.1%} within {BOUND_MS:.0f} ms"
            print(f"ours, frames {name}: {own.size}, mean {own.mean():.2f}, {spread}; {within}")


def report(out: Path, rows: list, pooled: dict, predicted: dict, spent: dict, pictures: list) -> None:
    """Print the tables; write them, the curves and the pictures."""
    with (out / "edges.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([["sequence", "seed", "method", "rmse_px", "std_px", "without"], *rows])
    names = list(pooled)
    print("RMSE ± spread over frames, px; frames without edges")
    for sequence in dict.fromkeys(row[0] for row in rows):
        for seed in dict.fromkeys(row[1] for row in rows if row[0] == sequence):
            cells = {row[2]: f"{row[3]:.1f} ± {row[4]:.1f} ({row[5]})" for row in rows if row[:2] == [sequence, seed]}
            print(f"| {sequence} {seed} | " + " | ".join(f"{name}: {cells[name]}" for name in names) + " |")
    for name, own in pooled.items():
        alls = np.concatenate(own)
        print(f"all: {name}: {np.sqrt(np.mean(alls**2)):.2f} px, median {np.median(np.abs(alls)):.2f} px")
    if predicted:
        draw_predictions(out, predicted)
    reference = float(np.median(np.concatenate(spent[OPENCV]))) if OPENCV in spent else math.nan
    for name, own in spent.items():
        ms = 1e3 * np.concatenate(own)
        ratio = 1e-3 * float(np.median(ms)) / reference
        spread = f"median {np.median(ms):.2f} ms, 95 % {np.percentile(ms, 95):.2f}"
        print(f"{name}: {spread}, {ratio:.2f} × Canny + Hough")
    cv2.imwrite(str(out / "overlays.png"), np.vstack(pictures))
    print(f"wrote {out}")


if __name__ == "__main__":
    main()
