"""Search whole frames for the aircraft and print how often it is among the best 1, 3 and 12 candidates.

usage: GROUNDSTATION_DATA=… python benchmarks/acquisition_recall.py [--every N] [--list] [NAME …]

Clips: each segment of kind "aircraft" on its own, frames fed one after another as in a search that never ends,
every N-th one scored; a hit is a centre inside the labelled box or within 10 px of its middle. No calibration.
Sessions: both cameras with their angles interpolated at exposure; a hit is the same for the true silhouette's box.
Times are of the processor, on one core, without decoding.
"""

import argparse
import csv
import os
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.detection.candidate_finder import AcquisitionConfig, Candidate, CandidateFinder
from groundstation.rig.rig import load_rig

Box = tuple[float, float, float, float]
RANKS = (1, 3, 12)
SLACK_PX = 10.0


@dataclass(kw_only=True)
class RecallCounts:
    """Counts over the frames of one part."""

    frames: int = 0
    hits: dict[int, int] = field(default_factory=lambda: dict.fromkeys(RANKS, 0))
    moving: int = 0
    candidates: int = 0
    elapsed_s: list[float] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)

    def add(self, found: tuple[Candidate, ...], box: Box, name: str) -> None:
        """Score one frame against the box x, y, w, h of the target."""
        ranks = [i for i, c in enumerate(found) if is_hit(c, box)]
        self.frames += 1
        self.candidates += len(found)
        for n in RANKS:
            self.hits[n] += any(i < n for i in ranks)
        self.moving += any(found[i].moving for i in ranks)
        if not ranks or ranks[0] >= 3:
            self.missed.append(f"{name}:{ranks[0] + 1 if ranks else '-'}")

    def line(self, name: str) -> str:
        """Return one line of the printed table."""
        n = max(self.frames, 1)
        share = "  ".join(f"@{k} {100 * self.hits[k] / n:5.1f}" for k in RANKS)
        ms = 1e3 * np.array(self.elapsed_s or [0.0])
        return (
            f"{name:28s} {self.frames:5d} frames  {share}  moving {100 * self.moving / n:5.1f}  "
            f"candidates {self.candidates / n:4.1f}  median {np.median(ms):5.2f} ms  p99 {np.percentile(ms, 99):5.2f}"
        )


def is_hit(c: Candidate, box: Box) -> bool:
    x, y, w, h = box
    inside = x <= c.u_px <= x + w and y <= c.v_px <= y + h
    return inside or float(np.hypot(c.u_px - x - w / 2, c.v_px - y - h / 2)) <= SLACK_PX


def delivered_frames(path: Path) -> Iterator[tuple[int, ImageArray]]:
    video = cv2.VideoCapture(str(path))
    number = 0
    while True:
        good, image = video.read()
        if not good:
            return
        yield number, np.asarray(image, np.uint8)
        number += 1


def timed(
    finder: CandidateFinder, image: ImageArray, t_s: float, pose: FloatArray | None, tally: RecallCounts
) -> tuple[Candidate, ...]:
    start = time.process_time()
    found = finder.find(image, t_s, pose)
    tally.elapsed_s.append(time.process_time() - start)
    return found


def run_clips(folder: Path, every: int, names: list[str]) -> dict[str, RecallCounts]:
    with (folder / "boxes.csv").open() as file:
        boxes = {
            (r["clip"], int(r["frame"])): (float(r["x"]), float(r["y"]), float(r["w"]), float(r["h"]))
            for r in csv.DictReader(file)
            if r["x"]
        }
    with (folder / "segments.csv").open() as file:
        segments = [r for r in csv.DictReader(file) if r["kind"] == "aircraft"]
    tallies: dict[str, RecallCounts] = {}
    for clip in sorted({s["clip"] for s in segments}):
        if names and not any(n in clip for n in names):
            continue
        own = [s for s in segments if s["clip"] == clip]
        finder = None
        for number, image in delivered_frames(folder / f"{clip}.mp4"):
            for s in own:
                if not int(s["first_frame"]) <= number <= int(s["last_frame"]):
                    continue
                name = f"{clip} {s['first_frame']}"
                if number == int(s["first_frame"]) or finder is None:
                    finder = CandidateFinder(AcquisitionConfig(), (image.shape[1], image.shape[0]))
                tally = tallies.setdefault(name, RecallCounts())
                found = timed(finder, image, number / 30.0, None, tally)
                if number % every == 0 and (clip, number) in boxes:
                    tally.add(found, boxes[clip, number], str(number))
    return tallies


def run_session(folder: Path, every: int, moving_after_m: float) -> dict[str, RecallCounts]:
    rig = load_rig(folder / "rig.toml")
    with (folder / "frames.csv").open() as file:
        stamps = list(csv.DictReader(file))
    with (folder / "truth.csv").open() as file:
        truth = list(csv.DictReader(file))
    start_m = np.array([float(truth[0][k]) for k in ("x_m", "y_m", "z_m")])
    masks = np.load(folder / "masks.npz")
    ptu = np.genfromtxt(folder / "ptu.csv", delimiter=",", names=True)
    with (folder / "session.toml").open() as file:
        phases = session_phases(file.read())
    tallies: dict[str, RecallCounts] = {}
    for station in rig.stations:
        side, geometry = station.name, station.geometry()
        clock = np.array([station.ptu_clock.session_from_device(t) for t in ptu["t_s"]])
        finder = CandidateFinder(AcquisitionConfig(), station.lens.image_size_px, station.lens)
        for number, image in delivered_frames(folder / f"{side}.mp4"):
            t_s = float(stamps[number][f"{side}_t_s"])
            pan = np.radians(np.interp(t_s, clock, ptu[f"{side}_pan_deg"]))
            tilt = np.radians(np.interp(t_s, clock, ptu[f"{side}_tilt_deg"]))
            pose = geometry.camera_pose(float(pan), float(tilt)).runway_from_camera.T
            phase = next((n for a, b, n in phases if a <= t_s <= b), "?")
            position = np.array([float(truth[number][k]) for k in ("x_m", "y_m", "z_m")])
            if float(np.linalg.norm(position - start_m)) < moving_after_m:
                phase = "standing"
            tally = tallies.setdefault(f"{folder.name} {side} {phase}", RecallCounts())
            found = timed(finder, image, t_s, pose, tally)
            box = mask_box(masks, side, number, image.shape[:2])
            if number % every == 0 and box is not None:
                tally.add(found, box, str(number))
    return tallies


def session_phases(text: str) -> list[tuple[float, float, str]]:
    return [(p["from_s"], p["to_s"], p["background"]) for p in tomllib.loads(text).get("phase", [])]


def mask_box(masks: object, side: str, number: int, shape: tuple[int, ...]) -> Box | None:
    """Return the silhouette's box, None if nothing of it is in the image."""
    key = f"{side}_{number:04d}"
    if key not in masks or not masks[key].any():  # type: ignore[operator, index]
        return None
    rows, columns = np.nonzero(masks[key])  # type: ignore[index]
    x, y = masks[f"{key}_xy"]  # type: ignore[index]
    x0, y0 = float(x + columns.min()), float(y + rows.min())
    return x0, y0, float(columns.max() - columns.min() + 1), float(rows.max() - rows.min() + 1)


def total(tallies: list[RecallCounts]) -> RecallCounts:
    whole = RecallCounts()
    for t in tallies:
        whole.frames += t.frames
        whole.candidates += t.candidates
        whole.moving += t.moving
        whole.elapsed_s += t.elapsed_s
        for k in RANKS:
            whole.hits[k] += t.hits[k]
    return whole


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--every", type=int, default=10)
    parser.add_argument("--list", action="store_true", help="list the frames not found among the best three")
    parser.add_argument("names", nargs="*", help="parts of clip names, or session names")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    data = Path(os.environ["GROUNDSTATION_DATA"])
    sessions = [n for n in arguments.names if (data / n / "rig.toml").is_file()]
    clips = [n for n in arguments.names if n not in sessions]
    groups: dict[str, dict[str, RecallCounts]] = {}
    if clips or not arguments.names:
        groups["aircraft-clips"] = run_clips(data / "aircraft-clips", arguments.every, clips)
    for name in sessions or ([] if arguments.names else ["landing-1", "takeoff-1"]):
        groups[name] = run_session(data / name, arguments.every, 0.5 if name.startswith("takeoff") else 0.0)
    for name, tallies in groups.items():
        for key, tally in ((k, t) for k, t in tallies.items() if t.frames):
            print(tally.line(key))
            if arguments.list and tally.missed:
                print("      " + " ".join(tally.missed))
        print(total(list(tallies.values())).line(f"{name}: all") + "\n")


if __name__ == "__main__":
    main()
