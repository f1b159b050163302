"""Replays of a recorded session with noise, haze or blur added to its pictures: coverage, accuracy, consistency.

    python benchmarks/degraded_pictures.py SESSION --out DIR [--condition NAME …]

The pictures are degraded once for a folder, stored without loss, and replayed as they are by default. Coverage, RMSE
and ANEES are those of the summary against the truth (`groundstation evaluate`).
"""

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.session import load_session
from groundstation.sources.video_file import VideoFile

_SEED = 631
# levels; share of contrast that is left of the difference to the mean of the picture; px
_NOISE_SIGMA, _HAZE_SHARE, _BLUR_SIGMA_PX = 7.0, 0.45, 1.5


def _noisy(image: ImageArray, generator: np.random.Generator) -> ImageArray:
    noise = generator.standard_normal(image.shape, np.float32) * _NOISE_SIGMA
    return np.asarray(np.rint(image + noise).clip(0, 255), np.uint8)


def _hazy(image: ImageArray, _: np.random.Generator) -> ImageArray:
    mean = image.mean(axis=(0, 1))
    return np.asarray(np.rint(mean + _HAZE_SHARE * (image - mean)).clip(0, 255), np.uint8)


def _blurred(image: ImageArray, _: np.random.Generator) -> ImageArray:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), _BLUR_SIGMA_PX))


CONDITIONS: dict[str, Callable[[ImageArray, np.random.Generator], ImageArray]] = {
    "noise": _noisy,
    "haze": _hazy,
    "blur": _blurred,
}


def degraded(session: Path, folder: Path, change: Callable[[ImageArray, np.random.Generator], ImageArray]) -> Path:
    """Write a session with changed pictures, unless it is there; return its folder."""
    done = folder / "done"
    if done.exists():
        return folder
    folder.mkdir(parents=True, exist_ok=True)
    names = load_session(session).rig.names
    videos = {name: next(session.glob(f"{name}.*")) for name in names}
    for path in session.iterdir():
        if path not in videos.values():
            shutil.copyfile(path, folder / path.name)
    for name, path in videos.items():
        generator = np.random.default_rng([_SEED, len(name)])
        writer = None
        for frame in VideoFile(path).frames(0, None):
            if writer is None:
                size = (frame.image.shape[1], frame.image.shape[0])
                writer = cv2.VideoWriter(str(folder / f"{name}.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), 30.0, size)
            writer.write(change(frame.image, generator))
        if writer is not None:
            writer.release()
    done.touch()
    return folder


def _line(summary: dict[str, Any]) -> str:
    total = summary["accuracy"]["truth"]["total"]
    rmse = "/".join(f"{each:.3f}" for each in total["ekf"]["rmse_m"])
    return f"{100 * total['ekf']['coverage']:9.1f}%{total['anees']:8.2f}{rmse:>24}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--condition", nargs="+", choices=list(CONDITIONS), default=list(CONDITIONS), metavar="NAME")
    options = parser.parse_args()
    print(f"{'pictures':>10}{'coverage':>10}{'ANEES':>8}{'RMSE x, y, z m':>24}")
    for name in options.condition:
        folder = degraded(options.session, options.out / name, CONDITIONS[name])
        request = ReplayRequest(session=folder, out=options.out / f"{name}-result", rerun=False, report=False)
        print(f"{name:>10}{_line(replay(request).evaluation.summary)}", flush=True)


if __name__ == "__main__":
    main()
