"""Methods compared on rendered approaches: the tracker, the paper's energies and two baselines, each as a step."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from groundstation.experiments import onboard_edges
from groundstation.experiments.onboard_edges import rows_said
from groundstation.experiments.onboard_energies import from_last
from groundstation.onboard.edges.baselines import graph_cut_edges
from groundstation.onboard.edges.config import TrackerConfig, paper_config
from groundstation.onboard.edges.gradient_descent import DescentConfig, Energy
from groundstation.onboard.edges.lines import line_map, project_lines, shifted
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.edges.report import EdgeReport
from groundstation.onboard.edges.search_band import NoBand, RunwayGuess, band_rows, band_widths
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.scenes.sequences import NOSE_LENS, NoseFrame, Sequence

KAPPA, GUESS, LOST_PX = onboard_edges.KAPPA, onboard_edges.GUESS, onboard_edges.LOST_PX
SIZE = NOSE_LENS.image_size_px
Array = NDArray[np.float64]
Step = Callable[[NoseFrame], tuple[Array, Array] | None]


def truth(sequence: Sequence, pose: NoseCameraPose) -> tuple[Array, Array] | None:
    """Return the rows (2,) between which the true edges are visible, and their crossings there (4,).

    None where they are visible in too few rows to define an error, as in a gust on short final.
    """
    field = sequence.airfield
    guess = RunwayGuess(width_m=field.width_m, length_m=field.length_m, margin_m=0.5, margin_px=0.0)
    rows = band_rows(pose, KAPPA, SIZE, guess)
    if isinstance(rows, NoBand):
        return None
    lines = np.array([1.0, 0.0, -0.5 * field.width_m, 0.5 * field.width_m])
    return rows, project_lines(lines, line_map(pose, KAPPA), rows)[0]


def certain_truth(sequence: Sequence, pose: NoseCameraPose) -> tuple[Array, Array]:
    """Return the truth where it is required; ValueError where it is invisible."""
    wanted = truth(sequence, pose)
    if wanted is None:
        raise ValueError(f"{sequence.name}: got a frame in which the runway is not seen; wanted its edges")
    return wanted


def tracked(config: TrackerConfig, reports: list[EdgeReport] | None = None) -> Step:
    """Return a tracker as a step that gives crossings and their rows; its reports go to ``reports``."""
    tracker = EdgeTracker(KAPPA, SIZE, config)

    def step(frame: NoseFrame) -> tuple[Array, Array] | None:
        report = tracker.step(frame.image, frame.reported)
        edges = report.edges
        if reports is not None:
            reports.append(report)
        return None if edges is None else (edges.crossings_px, edges.rows_px)

    return step


def plain(energy: Energy) -> TrackerConfig:
    """Return this filter with only a descent from its prediction, in bands across: the difference between energies."""
    descent = DescentConfig(energy=energy)
    config = TrackerConfig(guess=GUESS, use_strip=False, profile=None, paint_m=0.0, band_m=4.0, gate=math.inf)
    return replace(config, descent=descent)


def graph_cut(frame: NoseFrame) -> tuple[Array, Array] | None:
    """Return GrabCut's edges, seeded by the nominal runway from the sensors' pose."""
    rows = rows_said(frame)
    if rows is None:
        return None
    e, lines = line_map(frame.reported, KAPPA), np.array([1.0, 0.0, -10.0, 10.0])
    guess, outer = project_lines(lines, e, rows)[0], project_lines(shifted(lines, 4.0), e, rows)[0]
    found = graph_cut_edges(frame.image, rows, guess, band_widths(guess, outer, rows, 2.5))
    return None if found is None else (found, rows)


def methods(sequence: Sequence, first: NoseCameraPose, reports: list[EdgeReport] | None = None) -> dict[str, Step]:
    """Return everything that is compared, ready for a sequence."""
    printed, flat = paper_config(GUESS), paper_config(GUESS, Energy.NON_VARIANT)
    return {
        "ours": tracked(TrackerConfig(guess=GUESS), reports),
        "spatially variant, KF": tracked(printed),
        "non-variant, KF": tracked(flat),
        "spatially variant, our filter": tracked(plain(Energy.SPATIALLY_VARIANT)),
        "non-variant, our filter": tracked(plain(Energy.NON_VARIANT)),
        "spatially variant, last frame": from_last(sequence, first, Energy.AS_PRINTED, across=False),
        "non-variant, last frame": from_last(sequence, first, Energy.NON_VARIANT, across=False),
        "Hough and Canny": onboard_edges.hough,
        "GrabCut": graph_cut,
    }
