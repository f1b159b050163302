"""Runway edges in rendered approaches: errors in px against truth, with distractors, in five lights; times; figures.

    python benchmarks/onboard_edges.py [--out DIR] [--draws N] [--first SEED] [--inset M] [--lamps M]
        [--only ours,hough,…] [--quick] [--workers N]

1. RMSE of the four ends of both edges, of the tracker, the paper's energies and the two baselines (the paper's
   Table 1), in N airfields drawn for each light; `--draws 0` takes the sequences' own, which the tracker was tuned on.
   Painted side lines lie on the edge, half a metre inside or anywhere to one metre, drawn as well, or `--inset M`;
   lamps stand 0.8 to 3 m outside, drawn too, or `--lamps M`.
   Of ours also the share of frames beyond 10 px, and of those that say they track all the same. Frames in which the
   true edges are seen in fewer than eight rows are counted and left out.
1b. The energies alone: down from lines 2, 4 and 8 px off, in bands across the runway and along the normals.
2. Prediction alone: the 3-D model, with an IMU or the pictures' motion, and constant velocity in the picture (Fig. 15).
3. Processor time of a frame, and over that of OpenCV's Canny with HoughLines in the same run; of ours also what
   frames of tracking, the first and the others take, and how many are within 5 ms.
4. Pictures with the edges drawn.
"""

import argparse
import base64
import csv
import math
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray
from onboard_edges_study.methods import Array
from onboard_edges_study.one_airfield import OPENCV, measured
from parallel_study import StudyRun, add_study_arguments

from groundstation.onboard.scenes.sequences import SEQUENCES

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parent.parent
BOUND_MS = 5.0  # of a frame's processor time, what is wanted
CHI2_999 = 18.47  # 4 degrees of freedom


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
    parser.add_argument("--inset", type=float, help="of painted side lines, m inside the edges; drawn if not given")
    parser.add_argument("--lamps", type=float, help="where lamps stand, m outside the edges; drawn if not given")
    parser.add_argument("--only", default="", help="methods whose names hold one of these words, comma between")
    parser.add_argument("--quick", action="store_true", help="leave out the predictions and OpenCV's times")
    add_study_arguments(parser, "onboard-edges", out=False)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    jobs = {
        f"{sequence.name}-{number}": {
            "sequence": k,
            "seed": options.first + number if options.draws else None,
            "inset": options.inset,
            "lamps": options.lamps,
            "only": [word for word in options.only.lower().split(",") if word],
            "quick": options.quick,
            "picture": number == 0,
        }
        for k, sequence in enumerate(SEQUENCES)
        for number in range(max(options.draws, 1))
    }
    found = list(StudyRun.chosen("onboard edges", options, options.out / "jobs").values(measured, jobs).values())
    predicted, spent, alone = {}, {}, {}
    for one in found:
        for name, off_px, own in one["alone"]:
            alone.setdefault((name, off_px), []).append(np.array(own))
        for name, own in [*one["times"].items(), *one["opencv"].items()]:
            spent.setdefault(name, []).append(np.array(own)[1:])
        for name, own in one["predicted"].items():
            predicted.setdefault(name, []).append(np.array(own))
    rows, pooled = show_errors(found)
    report(options.out, rows, pooled, predicted, spent)
    write_pictures(options.out, [one["picture"] for one in found if one["picture"] is not None])
    report_ours(found)
    for (name, off_px), own in alone.items():
        alls = np.concatenate(own)
        spread = f"{np.sqrt(np.mean(alls**2)):.2f} px, median {np.median(np.abs(alls)):.2f}"
        print(f"energy alone, from {off_px:.0f} px off: {name}: {spread}")


def show_errors(found: list[dict[str, Any]]) -> tuple[list[list[Any]], dict[str, list[Array]]]:
    """Print each airfield's errors; return them as rows of the table, and pooled by method."""
    rows, pooled = [], {}
    for one in found:
        for name, errors in one["errors"].items():
            own = np.array(errors)
            rms = float(np.sqrt(np.nanmean(own**2)))
            spread = float(np.nanstd(np.sqrt(np.mean(own**2, axis=1))))
            rows.append([one["name"], one["seed"], name, rms, spread, one["without"][name]])
            print(f"{one['name']} {one['seed']}: {name}: {rms:.1f} px{one['described'][name]}")
            pooled.setdefault(name, []).append(own)
        if one["tracking"]:
            square = np.array(one["square"])
            beyond = np.nanmean(square > CHI2_999)
            print(f"  ours: squared error over stated {np.nanmean(square):.1f} of 4, beyond 99.9 %: {beyond:.1%}")
    return rows, pooled


def write_pictures(out: Path, pictures: list[str]) -> None:
    """Write one sheet of the airfields' pictures, PNG in base64."""
    read = [cv2.imdecode(np.frombuffer(base64.b64decode(one), np.uint8), cv2.IMREAD_COLOR) for one in pictures]
    cv2.imwrite(str(out / "overlays.png"), np.vstack(read))
    print(f"wrote {out}")


def report_ours(found: list[dict[str, Any]]) -> None:
    """Print how often ours is wrong, and how often it does not say so."""
    ours = [one for one in found if one["tracking"]]
    if not ours:
        return
    px = np.concatenate([np.sqrt(np.mean(np.array(one["errors"]["ours"]) ** 2, axis=1)) for one in ours])
    tracking = np.concatenate([np.array(one["tracking"]) for one in ours])
    wrong, seen = px > 10.0, np.isfinite(px)
    share = f"{np.mean(wrong[seen]):.2%} beyond 10 px; says tracking in {np.mean(tracking):.1%}"
    print(f"ours: {px.size} frames, {np.sum(~seen)} in which the runway is not seen; {share}")
    print(f"ours: wrong and confident (tracking, beyond 10 px): {np.mean((wrong & tracking)[seen]):.2%}")
    square = np.concatenate([np.array(one["square"]) for one in ours])
    square = square[tracking & np.isfinite(square)]
    beyond = np.mean(square > CHI2_999)
    print(f"ours: squared error over stated, of 4: mean {np.mean(square):.2f}, beyond 99.9 %: {beyond:.2%}")
    ms = 1e3 * np.concatenate([np.array(one["times"]["ours"]) for one in ours])
    report_cost(ms, tracking, np.concatenate([np.arange(len(one["tracking"])) == 0 for one in ours]))


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


def report(out: Path, rows: list, pooled: dict, predicted: dict, spent: dict) -> None:
    """Print the tables; write them and the curves."""
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
        print(f"all: {name}: {np.sqrt(np.nanmean(alls**2)):.2f} px, median {np.nanmedian(np.abs(alls)):.2f} px")
    if predicted:
        draw_predictions(out, predicted)
    reference = float(np.median(np.concatenate(spent[OPENCV]))) if OPENCV in spent else math.nan
    for name, own in spent.items():
        ms = 1e3 * np.concatenate(own)
        ratio = 1e-3 * float(np.median(ms)) / reference
        spread = f"median {np.median(ms):.2f} ms, 95 % {np.percentile(ms, 95):.2f}"
        print(f"{name}: {spread}, {ratio:.2f} × Canny + Hough")


if __name__ == "__main__":
    main()
