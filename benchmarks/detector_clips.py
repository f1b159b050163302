"""Follow the aircraft of real clips from its first box and print the share of frames in which it was hit.

usage: GROUNDSTATION_DATA=… python benchmarks/detector_clips.py [CLIP …]

Each segment of kind "aircraft" starts on its first box. No calibration and no filter: the prediction is the
last target point moved on at constant velocity. A hit is a target point inside the labelled box or within
10 px of its centre; wrong is a point that is neither; the rest are misses.
"""

import csv
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.detection.config import DetectionConfig
from groundstation.detection.detector import DetectionHint, Detector, warm_up
from groundstation.detection.roi import place_roi
from groundstation.messages import Detection, Miss, MissReason

Box = tuple[float, float, float, float]
SIGMA_PX = 6.0  # camera shake and pans that no model foresees
VELOCITY_GAIN = 0.3
MAX_SIGMA_PX = 40.0


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A stretch of a clip with one aircraft in it."""

    clip: str
    first: int
    last: int


def read_segments(folder: Path) -> list[Segment]:
    with (folder / "segments.csv").open() as file:
        rows = list(csv.DictReader(file))
    return [
        Segment(clip=r["clip"], first=int(r["first_frame"]), last=int(r["last_frame"]))
        for r in rows
        if r["kind"] == "aircraft"
    ]


def read_boxes(folder: Path) -> dict[str, dict[int, Box]]:
    boxes: dict[str, dict[int, Box]] = {}
    with (folder / "boxes.csv").open() as file:
        for r in csv.DictReader(file):
            if r["x"]:
                box = (float(r["x"]), float(r["y"]), float(r["w"]), float(r["h"]))
                boxes.setdefault(r["clip"], {})[int(r["frame"])] = box
    return boxes


def read_frames(path: Path, first: int, last: int) -> Iterator[tuple[int, ImageArray]]:
    video = cv2.VideoCapture(str(path))
    index = 0
    while index <= last:
        good, image = video.read()
        if not good:
            break
        if index >= first:
            yield index, np.asarray(image, np.uint8)
        index += 1
    video.release()


class Follower:
    """A detector with the plainest of predictions: the last point at constant velocity."""

    def __init__(self, image_size_px: tuple[int, int], box: Box) -> None:
        self.config = DetectionConfig()
        self.image_size_px = image_size_px
        self.detector = Detector(self.config, image_size_px)
        self.point: FloatArray = np.array([box[0] + box[2] / 2, box[1] + box[3] / 2])
        self.velocity: FloatArray = np.zeros(2)
        self.variance = max(SIGMA_PX, 0.15 * max(box[2], box[3])) ** 2
        self.size: tuple[float, float] | None = (box[2], box[3])
        self.span: float | None = 0.7 * box[2]  # the labels are loose
        self.elapsed_s: list[float] = []

    def step(self, image: ImageArray) -> Detection | Miss:
        """Look at the next frame."""
        predicted = self.point + self.velocity
        covariance = self.variance * np.eye(2)
        roi = place_roi(predicted, covariance, self.size, self.config, self.image_size_px)
        if roi is None:
            return Miss(reason=MissReason.OUT_OF_VIEW)
        hint = DetectionHint(
            predicted_px=predicted,
            predicted_covariance_px2=covariance,
            expected_span_px=self.span,
            span_sigma_ratio=0.5,
        )
        start = time.perf_counter()
        result = self.detector.detect(image, roi, hint)
        self.elapsed_s.append(time.perf_counter() - start)
        if isinstance(result, Miss):
            self.point = predicted
            self.velocity *= 0.9
            self.variance = min(1.5 * self.variance, MAX_SIGMA_PX**2)
            return result
        found = np.array([result.u_px, result.v_px])
        self.velocity = self.velocity + VELOCITY_GAIN * (found - predicted)
        self.point, self.variance = found, SIGMA_PX**2
        self.size, self.span = (result.box[2], result.box[3]), None
        return result


def is_hit(point: Detection, box: Box) -> bool:
    x, y, w, h = box
    near = float(np.hypot(point.u_px - x - w / 2, point.v_px - y - h / 2)) < 10
    return near or (x <= point.u_px <= x + w and y <= point.v_px <= y + h)


def run_segment(folder: Path, segment: Segment, boxes: dict[int, Box]) -> tuple[int, int, int, list[float]]:
    """Return frames labelled, hit and wrong, and the times."""
    labelled = [f for f in sorted(boxes) if segment.first <= f <= segment.last]
    if not labelled:
        return 0, 0, 0, []
    follower: Follower | None = None
    hits = wrong = 0
    for index, image in read_frames(folder / f"{segment.clip}.mp4", labelled[0], segment.last):
        if follower is None:
            follower = Follower((image.shape[1], image.shape[0]), boxes[index])
        result = follower.step(image)
        if index in boxes and isinstance(result, Detection):
            hit = is_hit(result, boxes[index])
            hits += hit
            wrong += not hit
    return len(labelled), hits, wrong, follower.elapsed_s if follower is not None else []


def main() -> None:
    folder = Path(os.environ["GROUNDSTATION_DATA"]) / "aircraft-clips"
    warm_up()
    cv2.setNumThreads(1)
    boxes = read_boxes(folder)
    totals = np.zeros(3)
    times: list[float] = []
    for segment in read_segments(folder):
        if len(sys.argv) > 1 and segment.clip not in sys.argv[1:]:
            continue
        labelled, hits, wrong, elapsed = run_segment(folder, segment, boxes.get(segment.clip, {}))
        if labelled == 0:
            continue
        totals += (labelled, hits, wrong)
        times += elapsed
        share = hits / labelled
        print(
            f"{segment.clip} {segment.first:3d}-{segment.last:3d} frames {labelled:3d} hit {share:6.1%} "
            f"wrong {wrong / labelled:6.1%} median {1e3 * np.median(elapsed):5.2f} ms"
        )
    print(f"all: hit {totals[1] / totals[0]:.2%} wrong {totals[2] / totals[0]:.2%} of {totals[0]:.0f}")
    print(f"time per frame: median {1e3 * np.median(times):.2f} ms, p99 {1e3 * np.percentile(times, 99):.2f} ms")


if __name__ == "__main__":
    main()
