"""Fly real birds across real clips of aircraft, in front of the aircraft, and print whether they capture the track.

usage: GROUNDSTATION_DATA=… python benchmarks/bird_composites.py [--each N] [--seed N] [--save DIR] [--only N]
       [--detector classic] [--workers N] [CLIP …]

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
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from birds.counts import CompositeCounts, CompositeResult
from birds.cutting import Box, length_in, read_boxes, read_flocks
from birds.flights import Flight, Painter, draw_flight, local_sky
from birds.pictures import draw, save
from birds.scoring import RATE_HZ, Score
from detector_clips import read_segments
from parallel_study import StudyRun, add_study_arguments, in_blocks

from groundstation.arrays import ImageArray
from groundstation.box import box_of_size
from groundstation.detection.config import DetectorKind
from groundstation.messages import Detection
from groundstation.single_camera.make_tracker import make_tracker
from groundstation.tracking.warm_up import warm_up

SPEEDS_PX = ((3.0, 8.0), (8.0, 15.0), (15.0, 25.0))
RATIOS = ((0.3, 0.6), (0.6, 1.0), (1.0, 1.5), (1.5, 2.0))
SHORTEST = 75  # frames: shorter segments have no room
CUT_PX, CUT_RATIO = 30.0, 1.4
# composites to a job: some tens of seconds
BLOCK = 8


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


def run(
    flight: Flight,
    frames: dict[int, ImageArray],
    boxes: dict[int, Box],
    picture_of: set[int],
    detector: DetectorKind = DetectorKind.LEARNED,
) -> "FlightOutcome":
    """Composite and track one flight; keep the pictures of some frames, counted from the flight's first."""
    at = flight.crossing
    length = flight.size_ratio * length_in(frames[at], boxes[at])
    painter = Painter(flight=flight, length_px=length, sky=local_sky(frames[at], boxes[at]))
    height, width = frames[at].shape[:2]
    tracker, watched = make_tracker(detector, (width, height)), FlightOutcome()
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


def describe(number: int, flight: Flight, score: Score) -> str:
    back = score.back_after_s
    return (
        f"#{number:3d} {flight.clip} {flight.first}-{flight.last}, closest {flight.crossing}: "
        f"{flight.flock.clip} {flight.size_ratio:.2f} x, {flight.speed_px:.1f} px a frame"
        f"{' with the camera' if flight.with_camera else ''}, off by {flight.miss_px:.0f} px: "
        f"{'CAPTURED, ' if score.captured else ''}back {'never' if back is None else f'after {back:.2f} s'}, "
        f"wrong {score.wrong_frames}, clear from {flight.first + score.clear_from}"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedFlights:
    """The flights of a plan with the boxes of all clips, read and drawn once for each process."""

    flights: dict[int, tuple[tuple[int, int], Flight]]
    boxes: dict[str, dict[int, Box]]


@cache
def planned(folder: str, each: int, seed: int, clips: tuple[str, ...]) -> PlannedFlights:
    """Return the flights of a plan by number."""
    cv2.setNumThreads(1)
    flights = plan(Path(folder), each, seed, list(clips))
    boxes = read_boxes(Path(folder) / "aircraft-clips")
    return PlannedFlights(flights={number: (cell, flight) for number, cell, flight in flights}, boxes=boxes)


def tracked(job: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the results of some composites over one clip, as JSON has them; pictures of what failed go to `save`."""
    folder, detector = job["plan"][0], DetectorKind(job["detector"])
    warm_up(detector)
    whole = planned(*job["plan"][:3], tuple(job["plan"][3]))
    here = {number: whole.flights[number] for number in job["numbers"]}
    wanted = {k for _, f in here.values() for k in range(f.first, f.last + 1)}
    frames = read_clip(Path(folder) / "aircraft-clips" / f"{job['clip']}.mp4", wanted)
    found = []
    for number, (cell, flight) in here.items():
        watched = run(flight, frames, whole.boxes[flight.clip], set(), detector)
        score = watched.score
        result = CompositeResult(
            number=number,
            cell=cell,
            text=describe(number, flight, score),
            captured=score.captured,
            back_s=score.back_after_s,
            wrong=score.wrong_frames,
            frames=len(score.points),
            missed=score.missed_after,
            clear=len(score.points) - score.clear_from,
            elapsed_s=watched.elapsed_s,
        )
        found.append(asdict(result))
        if job["save"] and (result.failed or job["only"]):
            middle = score.clear_from
            near = set(range(middle - 16, middle)) | set(range(middle, middle + 32, 2))
            save(Path(job["save"]), number, run(flight, frames, whole.boxes[flight.clip], near, detector).pictures)
    return found


def jobs_of(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """Return the composites in blocks of one clip."""
    drawn = (str(Path(os.environ["GROUNDSTATION_DATA"]).absolute()), options.each, options.seed, tuple(options.clips))
    numbers: dict[str, list[int]] = {}
    for number, (_, flight) in planned(*drawn).flights.items():
        if options.only in (None, number):
            numbers.setdefault(flight.clip, []).append(number)
    same = {
        "plan": drawn,
        "detector": options.detector.value,
        "only": options.only is not None,
        "save": None if options.save is None else str(options.save.absolute()),
    }
    return {
        f"{clip}-{block[0]}": {"clip": clip, "numbers": block, **same}
        for clip in sorted(numbers)
        for block in in_blocks(numbers[clip], BLOCK)
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=20, metavar="N", help="composites for each size and speed")
    parser.add_argument("--seed", type=int, default=1, help="of the random draws")
    parser.add_argument("--save", type=Path, metavar="DIR", help="write pictures of the failures there")
    parser.add_argument("--only", type=int, metavar="N", help="one composite only, with pictures if --save")
    parser.add_argument("--detector", type=DetectorKind, choices=tuple(DetectorKind), default=DetectorKind.LEARNED)
    parser.add_argument("clips", nargs="*", metavar="CLIP", help="parts of clip names")
    add_study_arguments(parser, "bird-composites")
    options = parser.parse_args()
    blocks = StudyRun.chosen("birds", options).values(tracked, jobs_of(options))
    cells: dict[tuple[int, int], CompositeCounts] = {}
    total, elapsed = CompositeCounts(), []
    for value in (value for block in blocks.values() for value in block):
        result = CompositeResult(**value | {"cell": tuple(value["cell"])})
        cells.setdefault(result.cell, CompositeCounts()).add(result)
        total.add(result)
        elapsed += result.elapsed_s
        if result.failed or options.only is not None:
            print(result.text)
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
