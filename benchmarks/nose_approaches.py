"""`onboard edges` on approaches that another renderer drew: errors, stated sigma, misleading frames.

    python benchmarks/nose_approaches.py [--draws N] [--light clear,dusk,…] [--clips clear-far,…] [--each]

Read from $GROUNDSTATION_DATA/nose-approaches. Each clip is tracked with its exact pose; with white noise of 0.05° and
0.05 m in each frame's pose, N draws; and without any pose, by the pictures' own motion. Lights but `clear` are made of
the clear pictures: they are no renderer's, and only show what follows from less contrast and more noise.

Errors are those of the four ends of both edges, at the rows that the tracker reports. A frame without edges has no
error; one is misleading if it says `tracking` and an end is off by more than five of its stated sigmas. NEES is the
squared error over the stated covariance, over 4; `3 sigma` the share of tracking frames in which no end is off by more.
"""

import argparse
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from nose_study.clips import CLIPS, LIGHTS, Array, NoseClip, load_clip, relit, wrongs

from groundstation.onboard.edges.config import TrackerConfig, with_noise, without_log
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.edges.report import EdgeReport, EdgeStatus
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.edges.visual_odometry import VisualOdometry

ATTITUDE_DEG, POSITION_M = 0.05, 0.05
BEYOND_PX, MISLEADING, COVERED = 2.0, 5.0, 3.0
Poses = Callable[[int], NoseCameraPose]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClipScore:
    """One run: errors and sigmas (n, 4) px, NEES (n,) of 4 over 4, NaN without edges; and whether it was tracking."""

    errors: Array
    sigmas: Array
    nees: Array
    tracking: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        """Return in which frames there were edges."""
        return np.isfinite(self.nees)

    @property
    def rms_px(self) -> float:
        """Return the root mean square of frames with edges."""
        return float(np.sqrt(np.mean(self.errors[self.seen] ** 2))) if self.seen.any() else math.nan

    @property
    def beyond(self) -> np.ndarray:
        """Return in which frames an end is off by more than `BEYOND_PX`."""
        return np.asarray(np.abs(self.errors[self.seen]).max(axis=1) > BEYOND_PX)

    def over(self, sigmas: float) -> np.ndarray:
        """Return which of the tracking frames have an end that is off by more than so many stated sigmas."""
        own = self.tracking & self.seen
        return np.asarray((np.abs(self.errors[own]) / self.sigmas[own]).max(axis=1, initial=0.0) > sigmas)


def scored(clip: NoseClip, poses: Poses, config: TrackerConfig) -> tuple[ClipScore, list[EdgeReport]]:
    """Track a clip with the poses of its frames."""
    tracker = EdgeTracker(clip.kappa, clip.camera.lens.image_size_px, config)
    count = len(clip.pictures)
    errors, sigmas, nees = np.full((count, 4), np.nan), np.full((count, 4), np.nan), np.full(count, np.nan)
    reports = [tracker.step(image, poses(k)) for k, image in enumerate(clip.pictures)]
    for k, report in enumerate(reports):
        if report.edges is None:
            continue
        errors[k] = report.edges.crossings_px - clip.true_crossings(k, report.edges.rows_px)
        covariance = report.edges.covariance_px2
        sigmas[k] = np.sqrt(np.diag(covariance))
        nees[k] = float(errors[k] @ np.linalg.solve(covariance, errors[k])) / 4.0
    tracking = np.array([report.status is EdgeStatus.TRACKING for report in reports])
    return ClipScore(errors=errors, sigmas=sigmas, nees=nees, tracking=tracking), reports


def noisy(clip: NoseClip, seed: int) -> Poses:
    """Return the poses of a draw of noise."""
    wrong = list(wrongs(len(clip.pictures), seed, ATTITUDE_DEG, POSITION_M))
    return lambda k: clip.pose(k, wrong[k])


def by_pictures(clip: NoseClip) -> Poses:
    """Return the poses by the pictures' own motion, from the camera file's start."""
    if clip.camera.start is None:
        raise SystemExit(f"{clip.folder / 'nose.toml'}: start: got nothing, wanted a [start] table")
    odometry = VisualOdometry(clip.kappa, clip.camera.start)
    return lambda k: odometry.step(float(clip.t_s[k]), clip.pictures[k]).pose


def show(name: str, scores: list[ClipScore]) -> None:
    """Print a line of the table; of several draws the range of rms and the sums of frames."""
    rms = [score.rms_px for score in scores]
    count = sum(score.errors.shape[0] for score in scores)
    beyond = sum(int(score.beyond.sum()) for score in scores)
    tracking = sum(int((score.tracking & score.seen).sum()) for score in scores)
    misleading = sum(int(score.over(MISLEADING).sum()) for score in scores)
    covered = 1.0 - sum(int(score.over(COVERED).sum()) for score in scores) / max(tracking, 1)
    seen = [score for score in scores if score.seen.any()]
    sigma = float(np.mean([np.sqrt(np.mean(score.sigmas[score.seen] ** 2)) for score in seen])) if seen else math.nan
    nees = float(np.mean([np.mean(score.nees[score.seen]) for score in seen])) if seen else math.nan
    spread = (
        f"{rms[0]:.2f}" if len(rms) == 1 else f"{np.nanmin(rms):.2f}–{np.nanmax(rms):.2f}, mean {np.nanmean(rms):.2f}"
    )
    print(
        f"| {name} | {spread} | {beyond} of {count} | {sigma:.2f} | {nees:.2f} | {tracking} | {covered:.1%} "
        f"| {misleading} |",
        flush=True,
    )


def each_frame(score: ClipScore, reports: list[EdgeReport]) -> None:
    """Print the frames of a run."""
    for k, report in enumerate(reports):
        errors = " ".join(f"{e:6.2f} ({s:4.2f})" for e, s in zip(score.errors[k], score.sigmas[k], strict=True))
        print(f"  {k:2d} {report.status.value:9s} {report.miss.value:6s} {errors}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=5, help="draws of noise for each clip")
    parser.add_argument("--first", type=int, default=0, help="seed of the first draw")
    parser.add_argument("--light", default="clear", help=f"comma between: {', '.join(LIGHTS)}")
    parser.add_argument("--clips", default=",".join(CLIPS), help="comma between")
    parser.add_argument("--only", default="exact,noise,none", help="exact pose, noise, none: comma between")
    parser.add_argument("--each", action="store_true", help="print every frame")
    options = parser.parse_args()
    folder = Path(os.environ.get("GROUNDSTATION_DATA", "data")) / "nose-approaches"
    cv2.setNumThreads(1)
    print("| clip, pose | rms px | frames beyond 2 px | stated sigma px | NEES | tracking | 3 sigma | misleading |")
    print("|---|---|---|---|---|---|---|---|")
    started = time.process_time()
    for name in options.clips.split(","):
        clear = load_clip(folder / name)
        for light in options.light.split(","):
            clip = relit(clear, light)
            config = with_noise(TrackerConfig(guess=clip.camera.guess), clip.camera.noise)
            runs: dict[str, list[Callable[[], Poses]]] = {
                "exact": [lambda clip=clip: clip.pose],  # type: ignore[misc]
                "noise": [
                    lambda clip=clip, seed=seed: noisy(clip, seed)  # type: ignore[misc]
                    for seed in range(options.first, options.first + options.draws)
                ],
                "none": [lambda clip=clip: by_pictures(clip)],  # type: ignore[misc]
            }
            for kind in options.only.split(","):
                own = without_log(config) if kind == "none" else config
                found = [scored(clip, poses(), own) for poses in runs[kind]]
                if options.each:
                    for score, reports in found:
                        each_frame(score, reports)
                show(f"{clip.name}, {kind}", [score for score, _ in found])
    print(f"{time.process_time() - started:.0f} s of processor time")


if __name__ == "__main__":
    main()
