"""Accuracy of the detector in a replay, with the filter's own predictions, against the truth.

    python benchmarks/detector_on_rendered.py [--out DIR] [SESSION …]

Each session (with truth.csv and masks.npz) is replayed and every detection evaluated: the target point's error
in px and in percent of the silhouette's width, whether it is within the stated covariance, the overlap with the true
silhouette, and whether nose and silhouette are in the region of interest; by background and by width. Default: the
bundled landing and, where $GROUNDSTATION_DATA has it, takeoff-1. With --out the tables are written as CSV, too.
"""

import argparse
import os
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from detector_against_truth import Key, true_pixels

from groundstation.experiments.detection_tables import flown_table
from groundstation.experiments.detector_outcomes import DetectorOutcome, FrameTruth, judged
from groundstation.experiments.truth_scenes import background_at
from groundstation.messages import Frame
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.session import load_session
from groundstation.sources.true_silhouettes import SilhouetteArchive
from groundstation.tracking.camera_tracker import CameraTracker, SearchResult

ROOT = Path(__file__).resolve().parent.parent


def flown(folder: Path) -> list[DetectorOutcome]:
    """Replay a session and return its evaluated detections, those with the nose in view, in order of time."""
    session, noses = load_session(folder), true_pixels(folder)
    silhouettes = SilhouetteArchive(session)
    outcomes: dict[Key, DetectorOutcome] = {}
    look = CameraTracker.detect

    def noted(self: CameraTracker, frame: Frame, *rest: Any) -> SearchResult | None:
        seen = look(self, frame, *rest)
        key = (frame.station, frame.epoch)
        silhouette = silhouettes.find(*key)
        if seen is not None and seen.roi is not None and key in noses and silhouette is not None:
            background = background_at(session, frame.t_s)
            truth = FrameTruth(nose_px=np.asarray(noses[key][:2]), silhouette=silhouette, background=background)
            outcomes[key] = judged(frame, truth, (seen.roi, seen.result))
        return seen

    CameraTracker.detect = noted  # type: ignore[method-assign, assignment]
    try:
        with tempfile.TemporaryDirectory() as out:
            result = replay(ReplayRequest(session=folder, out=Path(out), rerun=False))
    finally:
        CameraTracker.detect = look  # type: ignore[method-assign]
    if result.fault is not None:
        raise result.fault
    return sorted(outcomes.values(), key=lambda o: (o.t_s, o.station))


def main() -> None:
    """Replay each session and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sessions", type=Path, nargs="*", metavar="SESSION")
    parser.add_argument("--out", type=Path, metavar="DIR")
    options = parser.parse_args()
    sessions = options.sessions or [ROOT / "recordings" / "landing-1"]
    other = Path(os.environ.get("GROUNDSTATION_DATA", "")) / "takeoff-1"
    if not options.sessions and other.is_dir():
        sessions.append(other)
    cv2.setNumThreads(1)
    for folder in sessions:
        table = flown_table(flown(folder))
        print(f"# {folder.name}\n\n{table.markdown()}", flush=True)
        if options.out is not None:
            (options.out / folder.name).mkdir(parents=True, exist_ok=True)
            table.write_csv(options.out / folder.name)


if __name__ == "__main__":
    main()
