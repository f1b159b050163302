"""Processor time of the learned channel a frame, set against OpenCV's CSRT and the classic detector in the same run.

    python benchmarks/channel_speed.py [--csrt PYTHON] [--frames N] [SESSION]

Each frame that shows the target is detected with its true place as the prediction (3 px of sigma) and its true
width; CSRT follows from the first one on. All on one thread. "search" is a search of the whole frame.
"""

import argparse
import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from groundstation.bank.csrt_process import CsrtProcess
from groundstation.bank.session_truth import SessionTruth
from groundstation.box import Box, box_of_size
from groundstation.detection.candidate_finder import AcquisitionConfig
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.make_detector import make_detector, make_finder
from groundstation.detection.working_image import DetectionHint
from groundstation.picture import as_picture
from groundstation.session import load_session
from groundstation.sources.true_silhouettes import TrueSilhouette
from groundstation.sources.video_file import VideoFile
from groundstation.tracking.warm_up import warm_up

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("GROUNDSTATION_DATA", ROOT.parent / "shared" / "data"))
_SIGMA_PX, _MARGIN_PX = 3.0, 60


def hint_of(silhouette: TrueSilhouette) -> DetectionHint:
    return DetectionHint(
        predicted_px=silhouette.centre_px,
        predicted_covariance_px2=np.eye(2) * _SIGMA_PX**2,
        expected_span_px=float(silhouette.width_px),
        span_sigma_ratio=0.1,
    )


def timed(times: list[float], work: Callable[[], object]) -> None:
    began = time.thread_time()
    work()
    times.append(time.thread_time() - began)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("session", nargs="?", default="landing-clutter")
    parser.add_argument("--csrt", type=Path, metavar="PYTHON", help="a Python with opencv-contrib below 5")
    parser.add_argument("--frames", type=int, default=200, metavar="N")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    folder = DATA / given.session if (DATA / given.session).is_dir() else Path(given.session)
    session = load_session(folder)
    truth, station = SessionTruth(session), session.rig.stations[0]
    size = station.lens.image_size_px
    kinds = {kind: DetectionConfig(detector=kind) for kind in DetectorKind}
    for kind in kinds:
        warm_up(kind)
    detectors = {kind: make_detector(config, size) for kind, config in kinds.items()}
    finders = {kind: make_finder(AcquisitionConfig(), config, station.lens) for kind, config in kinds.items()}
    times: dict[str, list[float]] = {}
    with ExitStack() as opened:
        csrt = opened.enter_context(CsrtProcess(given.csrt)) if given.csrt else None
        started = False
        for frame in VideoFile(folder / f"{station.name}.mp4").frames(0, min(given.frames, truth.pairs) - 1):
            seen = truth.frame(station.name, frame.index)
            if seen is None or not seen.visible:
                continue
            s, picture = seen.silhouette, as_picture(frame.image)
            h, w = s.mask.shape
            roi = Box(
                max(s.x - _MARGIN_PX, 0),
                max(s.y - _MARGIN_PX, 0),
                min(s.x + w + _MARGIN_PX, size[0]),
                min(s.y + h + _MARGIN_PX, size[1]),
            )
            for kind, detector in detectors.items():
                timed(times.setdefault(f"{kind} detector", []), partial(detector.detect, picture, roi, hint_of(s)))
            for kind, finder in finders.items():
                timed(times.setdefault(f"{kind} search", []), partial(finder.find, picture, 0.1 * frame.index))
            if csrt is not None and not started:
                csrt.start(frame.image, box_of_size(float(s.x), float(s.y), float(w), float(h)))
                started = True
            elif csrt is not None:
                times.setdefault("CSRT update", []).append(csrt.update(frame.image)[0])
    print(f"{'ms of one core':24}{'frames':>8}{'median':>9}{'99 %':>9}")
    for name, values in times.items():
        low, high = 1e3 * np.median(values), 1e3 * np.quantile(values, 0.99)
        print(f"{name:24}{len(values):8d}{low:9.2f}{high:9.2f}")


if __name__ == "__main__":
    main()
