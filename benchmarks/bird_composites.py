"""Fly real birds across real clips of aircraft, in front of the aircraft, and print whether they capture the track.

usage: GROUNDSTATION_DATA=… python benchmarks/bird_composites.py [--each N] [--seed N] [--save DIR] [--only N]
       [CLIP …]

Birds are cut out of bird-clips by their contrast against the local sky, with soft edges, as films of consecutive
frames, and composited over the `aircraft` segments of aircraft-clips: scaled to 0.3–2 times the length of the
aircraft's silhouette, in the local sky's light, on straight paths in any direction that pass the middle of its
labelled box within 0–40 px at 3–25 px a frame; half of them go with the camera's motion (pan, shake), the others
cross the picture at constant speed. The tracker is started on a labelled box 1–2 s before the closest approach and
runs until 1.5 s after the overlap (or the end of the segment, at least 1 s). No flight goes across a cut.

A hit is a target point inside the labelled box or within 10 px of its middle; wrong is a frame with a point that is
no hit. The overlap ends with the last frame in which the bird's box and the labelled box have a common part.
capture: after it three frames or more, or the last one, have a point that is no hit and lies on or near the bird
(within 0.75 of its length or 10 px of its middle). back: time from the first frame after the overlap until the
aircraft is hit in three frames running; "late" are those that take more than 0.5 s.
"""

import argparse
import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from birds.cutting import Box, length_in, read_boxes, read_flocks
from birds.flights import Flight, Painter, draw_flight, local_sky
from birds.scoring import RATE_HZ, Score
from detector_clips import read_segments

from groundstation.arrays import ImageArray
from groundstation.box import box_of_size
from groundstation.messages import Detection
from groundstation.single_camera.pixel_tracker import PixelTracker
from groundstation.tracking.warm_up import warm_up

SPEEDS_PX = ((3.0, 8.0), (8.0, 15.0), (15.0, 25.0))
RATIOS = ((0.3, 0.6), (0.6, 1.0), (1.0, 1.5), (1.5, 2.0))
LATE_S = 0.5
SHORTEST = 75  # frames: shorter segments have no room
CUT_PX, CUT_RATIO = 30.0, 1.4


@dataclass(kw_only=True)
class CompositeCounts:
    """Counts over composites."""

    composites: int = 0
    captured: int = 0
    late: int = 0
    wrong: int = 0
    frames: int = 0
    missed: int = 0
    clear: int = 0
    back_s: list[float] = field(default_factory=list)

    def add(self, score: Score) -> None:
        """Count one composite."""
        back = score.back_after_s
        self.composites += 1
        self.captured += score.captured
        self.late += back is None or back > LATE_S
        self.wrong += score.wrong_frames
        self.frames += len(score.points)
        self.missed += score.missed_after
        self.clear += len(score.points) - score.clear_from
        self.back_s.append(np.inf if back is None else back)

    def line(self, name: str) -> str:
        """Return one line of the printed table."""
        back = np.array(self.back_s or [0.0])
        return (
            f"{name:26s} {self.composites:5d} {self.captured:8d} {self.late:5d} {self.wrong:6d}/{self.frames:<6d}"
            f" {self.missed:5d}/{self.clear:<6d} {np.percentile(back, 95, method='higher'):7.2f} {back.max():7.2f}"
        )


def plan(folder: Path, each: int, seed: int, clips: list[str]) -> list[tuple[int, tuple[int, int], Flight]]:
    """Draw the flights: ``each`` for every size ratio and speed; return number, cell and flight."""
    generator = np.random.default_rng(seed)
    flocks = read_flocks(folder / "bird-clips")
    boxes = read_boxes(folder / "aircraft-clips")
    segments = [
        (s.clip, first, last)
        for s in read_segments(folder / "aircraft-clips")
        for first, last in between_cuts(boxes[s.clip], s.first, s.last)
        if s.kind == "aircraft" and last - first >= SHORTEST and (not clips or any(c in s.clip for c in clips))
    ]
    flights: list[tuple[int, tuple[int, int], Flight]] = []
    order: list[tuple[str, int, int]] = []
    for i, ratio in enumerate(RATIOS):
        for j, speed in enumerate(SPEEDS_PX):
            found = 0
            while found < each:
                # every segment has its turn
                order = order or [segments[k] for k in generator.permutation(len(segments))]
                segment = order.pop()
                flight = draw_flight(generator, flocks, segment, boxes[segment[0]], speed, ratio)
                if flight is not None:
                    flights.append((len(flights), (i, j), flight))
                    found += 1
    return flights


def between_cuts(boxes: dict[int, Box], first: int, last: int) -> list[tuple[int, int]]:
    """Return the parts of a segment, first and last frame: where its box has another place and size, there is a cut."""
    parts, begin = [], first
    for frame in range(first + 1, last + 1):
        if frame not in boxes or frame - 1 not in boxes:
            continue
        (x, y, w, h), (a, b, c, d) = boxes[frame], boxes[frame - 1]
        step = float(np.hypot(x + w / 2 - a - c / 2, y + h / 2 - b - d / 2))
        if step > CUT_PX and max(w / c, c / w) > CUT_RATIO:
            parts.append((begin, frame - 1))
            begin = frame
    return [*parts, (begin, last)]


def read_clip(path: Path, wanted: set[int]) -> dict[int, ImageArray]:
    """Decode the wanted frames of a clip."""
    video, frames = cv2.VideoCapture(str(path)), {}
    for index in range(max(wanted) + 1):
        if not video.grab():
            break
        if index in wanted:
            frames[index] = np.asarray(video.retrieve()[1], np.uint8)
    video.release()
    return frames


def run(flight: Flight, frames: dict[int, ImageArray], boxes: dict[int, Box], picture_of: set[int]) -> "FlightOutcome":
    """Composite and track one flight; keep the pictures of some frames, counted from the flight's first."""
    at = flight.crossing
    length = flight.size_ratio * length_in(frames[at], boxes[at])
    painter = Painter(flight=flight, length_px=length, sky=local_sky(frames[at], boxes[at]))
    height, width = frames[at].shape[:2]
    tracker, watched = PixelTracker((width, height)), FlightOutcome()
    for index in range(flight.first, flight.last + 1):
        image, bird = painter.paint(frames[index], index)
        began = time.perf_counter()
        if index == flight.first:
            track = tracker.start(image, index / RATE_HZ, box_of_size(*boxes[index]))
        else:
            track = tracker.step(image, index / RATE_HZ)
        watched.elapsed_s.append(time.perf_counter() - began)
        seen = track.result if isinstance(track.result, Detection) else None
        watched.score.add(None if seen is None else (seen.u_px, seen.v_px), boxes[index], bird)
        if index - flight.first in picture_of:
            watched.pictures[index] = draw(image, boxes[index], bird, seen)
    return watched


@dataclass(kw_only=True)
class FlightOutcome:
    """Outcome of one flight."""

    score: Score = field(default_factory=Score)
    elapsed_s: list[float] = field(default_factory=list)
    pictures: dict[int, ImageArray] = field(default_factory=dict)


def draw(image: ImageArray, label: Box, bird: Box | None, seen: Detection | None) -> ImageArray:
    """Return the surroundings of the label: label green, bird blue, what was seen red."""
    side, scale = 128, 2
    cx, cy = round(label[0] + label[2] / 2), round(label[1] + label[3] / 2)
    padded = cv2.copyMakeBorder(image, side, side, side, side, cv2.BORDER_REPLICATE)
    picture = cv2.resize(
        padded[cy : cy + 2 * side, cx : cx + 2 * side], None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST
    )
    outlined = None if seen is None else (seen.box.x0, seen.box.y0, *seen.box.size)
    for box, colour in ((label, (0, 200, 0)), (bird, (255, 80, 0)), (outlined, (0, 0, 255))):
        if box is not None:
            x, y, w, h = box
            corner = (round(scale * (x - cx + side)), round(scale * (y - cy + side)))
            cv2.rectangle(picture, corner, (corner[0] + round(scale * w), corner[1] + round(scale * h)), colour, 1)
    if seen is not None:
        at = (round(scale * (seen.u_px - cx + side)), round(scale * (seen.v_px - cy + side)))
        cv2.circle(picture, at, 3, (0, 0, 255), -1)
    return np.asarray(picture, np.uint8)


def save(folder: Path, number: int, watched: FlightOutcome) -> None:
    """Write a sheet of pictures around the overlap."""
    folder.mkdir(parents=True, exist_ok=True)
    tiles = []
    for index, picture in sorted(watched.pictures.items()):
        cv2.putText(picture, str(index), (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 255, 255), 1)
        tiles.append(picture)
    while len(tiles) % 4:
        tiles.append(np.zeros_like(tiles[0]))
    rows = [np.hstack(tiles[k : k + 4]) for k in range(0, len(tiles), 4)]
    cv2.imwrite(str(folder / f"{number:03d}.png"), np.vstack(rows))


def describe(number: int, flight: Flight, score: Score) -> str:
    back = score.back_after_s
    return (
        f"#{number:3d} {flight.clip} {flight.first}-{flight.last}, closest {flight.crossing}: "
        f"{flight.flock.clip} {flight.size_ratio:.2f} x, {flight.speed_px:.1f} px a frame"
        f"{' with the camera' if flight.with_camera else ''}, off by {flight.miss_px:.0f} px: "
        f"{'CAPTURED, ' if score.captured else ''}back {'never' if back is None else f'after {back:.2f} s'}, "
        f"wrong {score.wrong_frames}, clear from {flight.first + score.clear_from}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=20, metavar="N", help="composites for each size and speed")
    parser.add_argument("--seed", type=int, default=1, help="of the random draws")
    parser.add_argument("--save", type=Path, metavar="DIR", help="write pictures of the failures there")
    parser.add_argument("--only", type=int, metavar="N", help="one composite only, with pictures if --save")
    parser.add_argument("clips", nargs="*", metavar="CLIP", help="parts of clip names")
    options = parser.parse_args()
    folder = Path(os.environ["GROUNDSTATION_DATA"])
    warm_up()
    cv2.setNumThreads(1)
    flights = plan(folder, options.each, options.seed, options.clips)
    if options.only is not None:
        flights = [f for f in flights if f[0] == options.only]
    boxes = read_boxes(folder / "aircraft-clips")
    cells: dict[tuple[int, int], CompositeCounts] = {}
    total, elapsed = CompositeCounts(), []
    for clip in sorted({f.clip for _, _, f in flights}):
        here = [f for f in flights if f[2].clip == clip]
        wanted = {k for _, _, f in here for k in range(f.first, f.last + 1)}
        frames = read_clip(folder / "aircraft-clips" / f"{clip}.mp4", wanted)
        for number, cell, flight in here:
            watched = run(flight, frames, boxes[clip], set())
            score = watched.score
            cells.setdefault(cell, CompositeCounts()).add(score)
            total.add(score)
            elapsed += watched.elapsed_s
            back = score.back_after_s
            bad = score.captured or back is None or back > LATE_S
            if bad or score.wrong_frames or options.only is not None:
                print(describe(number, flight, score), flush=True)
                if options.save:
                    middle = score.clear_from
                    near = set(range(middle - 16, middle)) | set(range(middle, middle + 32, 2))
                    save(options.save, number, run(flight, frames, boxes[clip], near))
    print(
        f"\nseed {options.seed}; wrong: frames with a point off the aircraft, of all; missed: frames after the overlap"
    )
    print(
        f"{'size x, px a frame':26s} {'n':>5s} {'captured':>8s} {'late':>5s} {'wrong':>13s} {'missed':>12s}"
        " back 95 %, max"
    )
    for (i, j), tally in sorted(cells.items()):
        print(tally.line(f"{RATIOS[i][0]:.1f}–{RATIOS[i][1]:.1f} x  {SPEEDS_PX[j][0]:.0f}–{SPEEDS_PX[j][1]:.0f} px"))
    print(total.line("all"))
    ms = 1e3 * np.array(elapsed)
    print(f"one update: median {np.median(ms):.2f} ms, p99 {np.percentile(ms, 99):.2f} ms")


if __name__ == "__main__":
    main()
