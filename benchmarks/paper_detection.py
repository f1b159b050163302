"""The paper's detection experiments on this project's recordings, numbered as there, with the paper's values.

    python benchmarks/paper_detection.py [--out DIR] [--every N] [SESSION …]

1. The region of interest's basic size: time, and deviation from the full frame (figure 10, table 1).
2. Chan-Vese against snake and GVF snake, and scikit-image's two: time, errors, failures (figures 7–9, table 2).
3. The detector's accuracy by width of the silhouette and by background, and the consistency of its covariance.

For each session with exact truth (truth.csv and masks.npz), default the bundled landing, the tables are printed, and
written with the pictures into DIR/SESSION, default out/paper-detection. Predictions are the truth with seeded noise
(groundstation/experiments/truth_scenes.py), so all but the times repeats to the last digit.
One thread; times are its processor time. Some five minutes for the bundled landing.
"""

import argparse
import sys
from pathlib import Path

import cv2

from groundstation.detection.config import DetectorKind
from groundstation.experiments import detection_plots as plots
from groundstation.experiments import detection_tables as findings
from groundstation.experiments.detection_set_up import (
    FULL,
    METHODS,
    OURS,
    PAPER_METHODS,
    PAPER_ROI,
    PAPERS_CHOICE,
    SEED,
    SWEEP,
)
from groundstation.experiments.detector_outcomes import DetectorOutcome, watch
from groundstation.experiments.tables import ResultTable
from groundstation.experiments.truth_scenes import scenes
from groundstation.session import load_session
from groundstation.tracking.warm_up import warm_up

EVERY = "look at every N-th pair only: for a first impression, since the detectors then see a slower video"
ROOT = Path(__file__).resolve().parent.parent


def study(folder: Path, out: Path, every: int) -> list[ResultTable]:
    """Run the three experiments on one session, write them to ``out`` and return the tables."""
    session = load_session(folder)

    def progress(number: int) -> None:
        if sys.stderr.isatty():
            print(f"\r{session.name}: {number} frames", end="", file=sys.stderr)

    # the default is both the paper's size and the first of the methods: it is run once
    configs = {**SWEEP, **{name: config for name, config in METHODS.items() if name != OURS}}
    outcomes = watch(scenes(session, SEED, every=every), configs, progress)
    sweep = {name: outcomes[name] for name in SWEEP}
    methods: dict[str, list[DetectorOutcome]] = {
        name: outcomes[PAPERS_CHOICE if name == OURS else name] for name in METHODS
    }
    tables = [
        findings.roi_table(sweep, FULL, PAPER_ROI),
        findings.method_table(methods, PAPER_METHODS),
        findings.failure_table(methods),
        findings.accuracy_table(methods[OURS]),
    ]
    out.mkdir(parents=True, exist_ok=True)
    text = f"# The paper's detection experiments on {session.name}\n\n" + "\n".join(t.markdown() for t in tables)
    (out / "tables.md").write_text(text, encoding="utf-8")
    for table in tables:
        table.write_csv(out)
    plots.draw_roi_sweep(sweep, FULL, out / "roi_sweep.png")
    plots.draw_methods(methods, out / "methods.png")
    plots.draw_accuracy(methods[OURS], out / "accuracy.png")
    return tables


def main() -> None:
    """Study each session and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sessions", type=Path, nargs="*")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "paper-detection")
    parser.add_argument("--every", type=int, default=1, metavar="N", help=EVERY)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    warm_up(DetectorKind.CLASSIC)
    for folder in options.sessions or [ROOT / "recordings" / "landing-1"]:
        out = options.out / folder.name
        print(f"# {folder.name}\n")
        for table in study(folder, out, options.every):
            print(table.markdown())
        print(f"wrote {out}")


if __name__ == "__main__":
    main()
