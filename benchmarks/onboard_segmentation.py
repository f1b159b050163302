"""Segmentation energies frame by frame without a filter or a prediction of the edges (the paper's Figs. 9 and 10).

    python benchmarks/onboard_segmentation.py --draws 2 --first 41

The experiment of `groundstation reproduce --only edge-energies` on other draws, with our tracker, the paper's tracker,
and GrabCut, whose seeds the sensors' pose gives. 50 frames at 30 Hz by day, in broken clouds, haze, dusk and night; the
pavement's brightness changes along the runway, with slabs at its ends and rubber.
"""

import argparse
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from onboard_edges_study import methods as study

from groundstation.experiments.onboard_edges import GUESS, Step
from groundstation.experiments.onboard_energies import SCENES, changing_pavement, energies, errors_of
from groundstation.onboard.edges.config import TrackerConfig, paper_config
from groundstation.onboard.edges.gradient_descent import Energy
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.scenes.sequences import SEQUENCES, Renderer, Sequence


def methods(sequence: Sequence, first: NoseCameraPose) -> dict[str, Step]:
    """Return the compared methods."""
    across = replace(paper_config(GUESS, Energy.SPATIALLY_VARIANT), bands_across=True)
    return {
        "ours": study.tracked(TrackerConfig(guess=GUESS)),
        **energies(sequence, first),
        "GrabCut": study.graph_cut,
        "paper's filter: variant, bands across": study.tracked(across),
        "paper's filter: variant, as printed": study.tracked(paper_config(GUESS)),
        "paper's filter: non-variant": study.tracked(paper_config(GUESS, Energy.NON_VARIANT)),
    }


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
