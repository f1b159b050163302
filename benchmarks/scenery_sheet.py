"""A sheet of drawn sceneries as a camera near the runway's start sees them, for inspection.

    python benchmarks/scenery_sheet.py OUT.png [--first SEED] [--count N] [--columns N] [--focal PX]

Each picture is as a lens of this focal length shows it on a sensor of 1280 by 960 px, at half size and without noise.
"""

import argparse
import math
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.simulation.scenery import FineRange, Scenery, draw_scenery, fine_panorama

_SIZE_PX = (1280, 960)
_SHOWN = 0.5
_EYE_M = np.array([-7.0, 0.0, 1.8])
_STREAM = 733


def view(scenery: Scenery, focal_px: float, pan_rad: float, tilt_rad: float) -> ImageArray:
    """Return the view under pan and tilt, rad."""
    half = [0.5 * n / focal_px for n in _SIZE_PX]
    margin = 0.02
    fine = FineRange(
        azimuth_from_rad=-pan_rad - 1.15 * half[0] - margin,
        azimuth_to_rad=-pan_rad + 1.15 * half[0] + margin,
        elevation_from_rad=max(tilt_rad - half[1] - margin, -1.5),
        elevation_to_rad=min(tilt_rad + half[1] + margin, 1.5),
    )
    panorama = fine_panorama(scenery, _EYE_M, _SHOWN * focal_px / 0.8, grey=False, fine=fine)
    width, height = (int(_SHOWN * n) for n in _SIZE_PX)
    u, v = np.meshgrid(np.arange(width) - 0.5 * width, np.arange(height) - 0.5 * height)
    ahead, aside, down = np.full(u.shape, _SHOWN * focal_px), u, v
    level = ahead * math.cos(tilt_rad) + down * math.sin(tilt_rad)
    up = ahead * math.sin(tilt_rad) - down * math.cos(tilt_rad)
    azimuth = np.arctan2(aside, level) - pan_rad
    elevation = np.arctan2(up, np.hypot(aside, level))
    x = (azimuth - panorama.place[0]) * panorama.place[2]
    y = (panorama.place[1] - elevation) * panorama.place[2]
    return np.asarray(cv2.remap(panorama.image, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR), np.uint8)


def main() -> None:
    """Draw the sheet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--columns", type=int, default=5)
    parser.add_argument("--focal", type=float, default=2200.0)
    parser.add_argument("--pan", type=float, default=0.0)
    parser.add_argument("--tilt", type=float, default=2.5)
    given = parser.parse_args()
    pictures = []
    for seed in range(given.first, given.first + given.count):
        scenery = draw_scenery(np.random.default_rng([seed, _STREAM]))
        picture = view(scenery, given.focal, math.radians(given.pan), math.radians(given.tilt))
        words = f"{seed} {scenery.drawn_scenery} {scenery.drawn_sky} {scenery.runway.surface}"
        words += f" {scenery.haze.visibility_m / 1000.0:.1f} km"
        cv2.putText(picture, words, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 255), 1, cv2.LINE_AA)
        pictures.append(picture)
    while len(pictures) % given.columns:
        pictures.append(np.zeros_like(pictures[0]))
    rows = [np.hstack(pictures[k : k + given.columns]) for k in range(0, len(pictures), given.columns)]
    cv2.imwrite(str(given.out), np.vstack(rows))


if __name__ == "__main__":
    main()
