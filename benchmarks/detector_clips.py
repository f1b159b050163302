"""Track the aircraft of real clips with one camera and print the share of frames in which it was hit.

usage: GROUNDSTATION_DATA=… python benchmarks/detector_clips.py [--acquire] [--every N] [--half] [--noise SIGMA]
       [--grey] [--detector classic] [--kind contrail] [--csrt] [CLIP …]

Each segment is tracked on its own: started on its first box or, with --acquire, found by searching; then frames are
scored from 0.5 s on. A hit is a target point inside the labelled box or within 10 px of its centre (5 px at half
resolution); wrong is a point that is neither; the rest are misses. Times are processor times of one update of
the tracker, one thread, without decoding; CSRT's are, too. Without --kind, segments of kind "contrail" (the target is
the trail's head) are reported after those of kind "aircraft", and do not count in their total.

--csrt runs OpenCV's CSRT on the same frames in the same run, in a separate virtual environment (build/csrt-venv).
"""

import argparse
import csv
import os
import subprocess
import sys
import time
import venv
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.bank.csrt_process import CsrtProcess
from groundstation.box import box_of_size
from groundstation.detection.config import DetectorKind
from groundstation.messages import Detection
from groundstation.single_camera.learned_tracker import LearnedPixelTracker
from groundstation.single_camera.make_tracker import make_tracker
from groundstation.single_camera.pixel_tracker import PixelTracker
from groundstation.tracking.warm_up import warm_up

Box = tuple[float, float, float, float]
RATE_HZ = 30.0
SETTLED_S = 0.5
NEAR_PX = 10.0
CSRT_FOLDER = Path("build/csrt-venv")
CSRT_PACKAGE = "opencv-contrib-python-headless<5"


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A segment of a clip with one target in it."""

    clip: str
    first: int
    last: int
    kind: str


@dataclass(frozen=True, kw_only=True)
class Mode:
    """Degradation of the frames, the tracker, and whether it gets a start."""

    acquire: bool
    every: int
    half: bool
    noise: float
    grey: bool
    detector: DetectorKind


@dataclass(kw_only=True)
class TrackingCounts:
    """Counts over labelled frames, and times."""

    labelled: int = 0
    hits: int = 0
    wrong: int = 0
    elapsed_s: list[float] = field(default_factory=list)
    csrt_hits: int = 0
    csrt_s: list[float] = field(default_factory=list)

    def add(self, other: "TrackingCounts") -> None:
        """Add the counts and times of another one."""
        self.labelled += other.labelled
        self.hits += other.hits
        self.wrong += other.wrong
        self.elapsed_s += other.elapsed_s
        self.csrt_hits += other.csrt_hits
        self.csrt_s += other.csrt_s

    def line(self, name: str) -> str:
        """Return one line of the printed table."""
        n, ms = max(self.labelled, 1), 1e3 * np.array(self.elapsed_s or [0.0])
        text = (
            f"{name:24s} frames {self.labelled:4d} hit {self.hits / n:7.2%} wrong {self.wrong / n:7.2%} "
            f"median {np.median(ms):5.2f} ms p99 {np.percentile(ms, 99):6.2f} ms"
        )
        if self.csrt_s:
            median = float(np.median(self.csrt_s))
            ratio = float(np.median(self.elapsed_s)) / median
            text += f" | CSRT hit {self.csrt_hits / n:7.2%} median {1e3 * median:5.2f} ms, ours {ratio:.3f} of it"
        return text


def csrt_python() -> Path:
    """Return the Python with CSRT, installed once into a separate environment."""
    python = CSRT_FOLDER / "bin" / "python"
    if not (CSRT_FOLDER / "installed").is_file():
        print(f"installing {CSRT_PACKAGE} into {CSRT_FOLDER}", file=sys.stderr)
        venv.create(CSRT_FOLDER, with_pip=True, clear=True)
        pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, CSRT_PACKAGE], check=True)
        (CSRT_FOLDER / "installed").touch()
    return python


def read_segments(folder: Path) -> list[Segment]:
    with (folder / "segments.csv").open() as file:
        rows = list(csv.DictReader(file))
    return [
        Segment(clip=r["clip"], first=int(r["first_frame"]), last=int(r["last_frame"]), kind=r["kind"]) for r in rows
    ]


def read_boxes(folder: Path) -> dict[str, dict[int, Box]]:
    boxes: dict[str, dict[int, Box]] = {}
    with (folder / "boxes.csv").open() as file:
        for r in csv.DictReader(file):
            if r["x"]:
                box = (float(r["x"]), float(r["y"]), float(r["w"]), float(r["h"]))
                boxes.setdefault(r["clip"], {})[int(r["frame"])] = box
    return boxes


def read_frames(path: Path, first: int, last: int, mode: Mode) -> Iterator[tuple[int, ImageArray]]:
    """Yield every n-th frame, degraded by the mode."""
    generator = np.random.default_rng(1)
    video = cv2.VideoCapture(str(path))
    for index in range(last + 1):
        good = video.grab()
        if not good:
            break
        if index < first or (index - first) % mode.every:
            continue
        image = np.asarray(video.retrieve()[1], np.uint8)
        if mode.half:
            half = (image.shape[1] // 2, image.shape[0] // 2)
            image = np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA), np.uint8)
        if mode.grey:
            image = np.asarray(cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR), np.uint8)
        if mode.noise > 0:
            noisy = image + generator.normal(0.0, mode.noise, image.shape)
            image = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
        yield index, image
    video.release()


def is_hit(u: float, v: float, box: Box, near_px: float) -> bool:
    x, y, w, h = box
    inside = x <= u <= x + w and y <= v <= y + h
    return inside or float(np.hypot(u - x - w / 2, v - y - h / 2)) < near_px


def run_segment(
    folder: Path, segment: Segment, boxes: dict[int, Box], mode: Mode, csrt: CsrtProcess | None
) -> TrackingCounts:
    scale = 0.5 if mode.half else 1.0
    labels = {f: (b[0] * scale, b[1] * scale, b[2] * scale, b[3] * scale) for f, b in boxes.items()}
    inside = [f for f in sorted(labels) if segment.first <= f <= segment.last]
    tally = TrackingCounts()
    tracker: PixelTracker | LearnedPixelTracker | None = None
    frames = read_frames(folder / f"{segment.clip}.mp4", inside[0], segment.last, mode) if inside else iter(())
    for index, image in frames:
        label, first = labels.get(index), tracker is None
        if tracker is None:
            tracker = make_tracker(mode.detector, (image.shape[1], image.shape[0]))
        began = time.process_time()
        if first and not mode.acquire and label is not None:
            track = tracker.start(image, index / RATE_HZ, box_of_size(*label))
        else:
            track = tracker.step(image, index / RATE_HZ)
        tally.elapsed_s.append(time.process_time() - began)
        csrt_box: Box | None = None
        if csrt is not None and first and label is not None:
            csrt.start(image, box_of_size(*label))
        elif csrt is not None:
            elapsed, found = csrt.update(image)
            tally.csrt_s.append(elapsed)
            csrt_box = None if found is None else (found.x0, found.y0, found.w, found.h)
        if label is None or (mode.acquire and index - inside[0] < SETTLED_S * RATE_HZ):
            continue
        tally.labelled += 1
        if isinstance(track.result, Detection):
            hit = is_hit(track.result.u_px, track.result.v_px, label, NEAR_PX * scale)
            tally.hits += hit
            tally.wrong += not hit
        if first or csrt_box is not None:
            x, y, w, h = label if csrt_box is None else csrt_box
            tally.csrt_hits += is_hit(x + 0.5 * w, y + 0.5 * h, label, NEAR_PX * scale)
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--acquire", action="store_true", help="do not tell where the target is")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="every N-th frame only")
    parser.add_argument("--half", action="store_true", help="at half resolution")
    parser.add_argument("--noise", type=float, default=0.0, metavar="SIGMA", help="with added noise, grey levels")
    parser.add_argument("--grey", action="store_true", help="without colour")
    parser.add_argument("--detector", type=DetectorKind, choices=tuple(DetectorKind), default=DetectorKind.LEARNED)
    parser.add_argument("--kind", choices=("aircraft", "contrail"), help="one kind of segment only")
    parser.add_argument("--csrt", action="store_true", help="also run OpenCV's CSRT")
    parser.add_argument("clips", nargs="*", metavar="CLIP", help="parts of clip names")
    options = parser.parse_args()
    mode = Mode(
        acquire=options.acquire,
        every=options.every,
        half=options.half,
        noise=options.noise,
        grey=options.grey,
        detector=options.detector,
    )
    folder = Path(os.environ["GROUNDSTATION_DATA"]) / "aircraft-clips"
    csrt = CsrtProcess(csrt_python()) if options.csrt else None
    warm_up(options.detector)
    cv2.setNumThreads(1)
    boxes, segments = read_boxes(folder), read_segments(folder)
    for kind in ("aircraft", "contrail") if options.kind is None else (options.kind,):
        total = TrackingCounts()
        for segment in segments:
            if segment.kind != kind or (options.clips and not any(c in segment.clip for c in options.clips)):
                continue
            tally = run_segment(folder, segment, boxes.get(segment.clip, {}), mode, csrt)
            if tally.labelled:
                print(tally.line(f"{segment.clip} {segment.first:3d}-{segment.last:3d}"), flush=True)
            total.add(tally)
        print(total.line(f"{kind}: all") + "\n", flush=True)


if __name__ == "__main__":
    main()
