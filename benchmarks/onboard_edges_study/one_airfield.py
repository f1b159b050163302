"""One airfield of benchmarks/onboard_edges.py: rendered, every method run on it, as a job that any process can take."""

import base64
import math
import time
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from groundstation.onboard.edges.lines import crossings_at
from groundstation.onboard.edges.report import EdgeReport, EdgeStatus
from groundstation.onboard.scenes.sequences import SEQUENCES, NoseFrame, Renderer, Sequence, varied
from onboard_edges_study.energies import compare_energies, prediction
from onboard_edges_study.methods import LOST_PX, Array, methods, truth

OPENCV = "cv2.Canny + cv2.HoughLines, whole picture"
SHOWN = (0, 30, 59)


def measured(job: dict[str, Any]) -> dict[str, Any]:
    """Return what comes of one airfield, as JSON has it; ``job`` as benchmarks/onboard_edges.py makes it."""
    cv2.setNumThreads(1)
    sequence = SEQUENCES[job["sequence"]]
    drawn = sequence if job["seed"] is None else varied(sequence, job["seed"], job["inset"], job["lamps"])
    frames = list(Renderer(drawn).frames())
    # a process's first frame reads the compiled code, which is in no frame's time then
    methods(drawn, frames[0].truth)["ours"](frames[0])
    reports: list[EdgeReport] = []
    errors, times, without = measure(drawn, frames, job["only"], reports)
    return {
        "name": sequence.name,
        "seed": drawn.seed,
        "errors": _as_lists(errors),
        "times": _as_lists(times),
        "without": without,
        "described": {name: described(drawn, own) for name, own in errors.items()},
        "tracking": [report.status is EdgeStatus.TRACKING for report in reports],
        "square": [normalised(drawn, *pair) for pair in zip(frames, reports, strict=True)] if reports else [],
        "alone": [(*key, own.tolist()) for key, own in compare_energies(drawn, frames).items()],
        "predicted": {} if job["quick"] else _as_lists(prediction(drawn, frames)),
        "opencv": {} if job["quick"] else {OPENCV: opencv_time(frames).tolist()},
        "picture": _png(draw(drawn, frames)) if job["picture"] else None,
    }


def _as_lists(arrays: dict[str, Array]) -> dict[str, Any]:
    return {name: array.tolist() for name, array in arrays.items()}


def _png(picture: NDArray[np.uint8]) -> str:
    return base64.b64encode(cv2.imencode(".png", picture)[1].tobytes()).decode()


def measure(
    sequence: Sequence, frames: list[NoseFrame], only: list[str], reports: list[EdgeReport]
) -> tuple[dict[str, Array], dict[str, Array], dict[str, int]]:
    """Return of each method the errors (n, 4) px, processor times (n,) s, and frames without edges.

    A frame without edges counts with the last edges that there were, as one would have to fly on them. Where the true
    edges are not seen the errors are NaN: there is nothing to be right about.
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
            seen = truth(sequence, frame.truth)
            if seen is None:
                own.append(np.full(4, np.nan))
            elif last is None:
                own.append(np.full(4, LOST_PX))
            else:
                rows, wanted = seen
                own.append(np.clip(crossings_at(last[0], last[1], rows) - wanted, -LOST_PX, LOST_PX))
        errors[name], times[name], without[name] = np.array(own), np.array(spent), missing
    return errors, times, without


def normalised(sequence: Sequence, frame: NoseFrame, report: EdgeReport) -> float:
    """Return the squared error of ours over its covariance, at its own rows, of 4; NaN without edges or truth."""
    seen = truth(sequence, frame.truth)
    if report.edges is None or seen is None:
        return math.nan
    rows, wanted = seen
    e = report.edges.crossings_px - crossings_at(wanted, rows, report.edges.rows_px)
    return float(e @ np.linalg.solve(report.edges.covariance_px2, e))


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
        rows, wanted = truth(sequence, frame.truth) or (np.array([0.0, 1.0]), np.zeros(4))
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
                    cv2.line(picture, ends[0], ends[1], colour, 1, cv2.LINE_AA, 4)
            shown.append(picture[120:420])
    return np.hstack(shown)


def described(sequence: Sequence, errors: Array) -> str:
    """Return where painted line and lamps are, and in how many frames the true edges are not seen."""
    field, unseen = sequence.airfield, int(np.isnan(errors[:, 0]).sum())
    line = f"; line {field.edge_stripe_inset_m:.2f} m inside" if field.edge_stripe_m > 0.0 else "; no side line"
    if sequence.light.lamp_power > 0.0:
        line += f"; lamps {field.lamps_out_m:.2f} m outside"
    return line + (f"; {unseen} frames in which the runway is seen too flat are left out" if unseen else "")
