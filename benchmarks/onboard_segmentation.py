"""The energies alone, picture after picture, as in the paper's Figs. 9 and 10: no filter, no prediction of the edges.

    python benchmarks/onboard_segmentation.py --draws 2 --first 41

50 frames at 30 Hz by day, in broken clouds, haze, dusk and night; the pavement's brightness changes along the runway,
with slabs at its ends and rubber. Each descent starts where the last picture's ended, the first at the truth. The pose
that the sensors say, with its errors, tells the rows, the bands' widths and, for bands across the runway, which way
they lie; where the edges are it does not tell (but GrabCut, whose seeds it gives). Beside them the paper's tracker.
"""

import argparse
import math
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import onboard_edges as study
from numpy.typing import NDArray

from groundstation.onboard.edges.config import TrackerConfig, paper_config
from groundstation.onboard.edges.descent import DescentConfig, Energy, descend
from groundstation.onboard.edges.lines import crossings_at, line_map
from groundstation.onboard.edges.pose import CameraPose
from groundstation.onboard.edges.search_band import across_direction
from groundstation.onboard.scenes.sequences import SEQUENCES, NoseFrame, Renderer, Sequence, varied

Step = Callable[[NoseFrame], tuple[NDArray[np.float64], NDArray[np.float64]] | None]
SCENES = ("day", "day, broken cloud", "haze, sand", "dusk, turbulence", "night")
_GUST_DEG = (1.0, 0.5, 0.5)


def changing_pavement(sequence: Sequence, seed: int) -> Sequence:
    """Return another airfield with pavement from darker than the grass to lighter, filmed at 30 Hz."""
    drawn = varied(sequence, seed)
    roll, pitch, yaw = (math.radians(angle) for angle in _GUST_DEG)
    return replace(
        drawn,
        airfield=replace(drawn.airfield, repair=(0.3, 2.2), repair_tint=0.0, end_m=50.0),
        approach=replace(drawn.approach, rate_hz=30.0, frames=50, gust_rad=(roll, pitch, yaw), gust_s=1.0),
    )


def from_last(sequence: Sequence, first: CameraPose, energy: Energy, *, across: bool) -> Step:
    """Return a descent from the last picture's edges, in bands across the runway or along the lines' normals."""
    rows, last = study.truth(sequence, first)
    config = DescentConfig(energy=energy, gamma=1e-3, adaptive_gamma=False)

    def step(frame: NoseFrame) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        nonlocal rows, last
        now = study.rows_said(frame)
        if now is None:
            return None
        start = crossings_at(last, rows, now)
        widths = np.repeat(study.band_px(frame, now)[None, :], 2, axis=0)
        along = across_direction(line_map(frame.said, study.KAPPA)) if across else None
        last, rows = descend(frame.image, start, now, widths, config, along).crossings_px, now
        return last, rows

    return step


def methods(sequence: Sequence, first: CameraPose) -> dict[str, Step]:
    """Return what is compared."""
    guess = study.GUESS
    across = replace(paper_config(guess, Energy.SPATIALLY_VARIANT), bands_across=True)
    return {
        "ours": study.tracked(TrackerConfig(guess=guess)),
        "variant, bands across": from_last(sequence, first, Energy.SPATIALLY_VARIANT, across=True),
        "variant, along normals": from_last(sequence, first, Energy.SPATIALLY_VARIANT, across=False),
        "variant, as printed": from_last(sequence, first, Energy.AS_PRINTED, across=False),
        "non-variant": from_last(sequence, first, Energy.NON_VARIANT, across=False),
        "Hough and Canny": study.hough,
        "GrabCut": study.graph_cut,
        "paper's filter: variant, bands across": study.tracked(across),
        "paper's filter: variant, as printed": study.tracked(paper_config(guess)),
        "paper's filter: non-variant": study.tracked(paper_config(guess, Energy.NON_VARIANT)),
    }


def errors_of(step: Step, sequence: Sequence, frames: list[NoseFrame]) -> NDArray[np.float64]:
    """Return the errors (n, 4) px at the true rows; a frame without edges counts with the last ones."""
    own, last = [], None
    for frame in frames:
        last = step(frame) or last
        rows, wanted = study.truth(sequence, frame.truth)
        if last is None:
            own.append(np.full(4, study.LOST_PX))
            continue
        own.append(np.clip(crossings_at(last[0], last[1], rows) - wanted, -study.LOST_PX, study.LOST_PX))
    return np.array(own)


def main() -> None:
    """Render, follow and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=2, help="airfields of each scene (default 2)")
    parser.add_argument("--first", type=int, default=41, help="seed of the first (default 41)")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    pooled: dict[str, list[NDArray[np.float64]]] = {}
    for name in SCENES:
        scene = next(one for one in SEQUENCES if one.name == name)
        for seed in range(options.first, options.first + options.draws):
            sequence = changing_pavement(scene, seed)
            frames = list(Renderer(sequence).frames())
            for method, step in methods(sequence, frames[0].truth).items():
                own = errors_of(step, sequence, frames)
                pooled.setdefault(method, []).append(own)
                print(f"{name} {seed}: {method}: {np.sqrt((own**2).mean()):.1f} px", flush=True)
    for method, every in pooled.items():
        whole = np.concatenate(every)
        print(f"all: {method}: {np.sqrt((whole**2).mean()):.1f} px, median {np.median(np.abs(whole)):.1f}")


if __name__ == "__main__":
    main()
