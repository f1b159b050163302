"""The runway-edge paper's figures 9 to 11: the descent alone, with either energy, and the filter step by step."""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray
from groundstation.experiments.experiment import Findings, PaperFigure
from groundstation.experiments.onboard_edges import (
    FRAMES,
    GUESS,
    HZ,
    KAPPA,
    LOST_PX,
    SEED_STEP,
    rendered,
    true_edges,
)
from groundstation.experiments.onboard_pictures import draw_line
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.onboard.edges.config import paper_config
from groundstation.onboard.edges.gradient_descent import Energy, descend
from groundstation.onboard.edges.lines import crossings_at, line_map, project_lines, shifted
from groundstation.onboard.edges.report import Edges
from groundstation.onboard.edges.search_band import band_widths
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.scenes.sequences import NOSE_LENS, SEQUENCES, NoseFrame, Sequence

# with the tracker's weight of the distance from the initial value, and without
_ENERGIES = {
    "spatially variant": (Energy.AS_PRINTED, None),
    "non-variant": (Energy.NON_VARIANT, None),
    "spatially variant, γ = 0": (Energy.AS_PRINTED, 0.0),
    "non-variant, γ = 0": (Energy.NON_VARIANT, 0.0),
}
_SHOWN = tuple(_ENERGIES)[2:]
_EVALUATIONS = (1, 5, 10, 20, 40, 60)
# both edges that far off, to the same side: near the border, as in the paper's figure
_OFF_PX = 6.0
_BAND_M, _LEAST_BAND_PX = 4.0, 2.5
_TRUE, _ONE, _OTHER, _BLUE = (60, 60, 255), (255, 160, 60), (60, 200, 255), (255, 60, 60)
_CONSECUTIVE = 4
_ROWS = slice(120, 420)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _LightResult:
    """One light: its frames; by energy, the crossings (n, 4) carried from frame to frame; the filter's steps."""

    sequence: Sequence
    frames: list[NoseFrame]
    carried: dict[str, FloatArray]
    steps: list[Edges | None]


def segmentation(recorded: TruthSession) -> Findings:
    """Descend with both energies, on one picture and through a sequence; and the Kalman filter's steps."""
    count = round(recorded.at_most_s(FRAMES / HZ) * HZ)
    seen = [_look(replace(s, seed=s.seed + SEED_STEP), count) for s in SEQUENCES[:4]]
    descents = {one.sequence.name: _descents(one) for one in seen}
    figures = (
        PaperFigure(
            name="edge_segmentation",
            title="Figures 9 and 10: segmentation alone",
            caption="Each light. Left, one picture after the whole descent from a guess 6 px off; then the last "
            "picture of the sequence, each begun where the one before ended. Truth red, spatially variant blue, "
            "non-variant yellow; both without γ.",
            draw=lambda path: _draw_alone(seen, path),
        ),
        PaperFigure(
            name="edge_filter",
            title="Figure 11: the Kalman filter, four consecutive steps",
            caption="First light: predicted blue, measured green, estimated red.",
            draw=lambda path: _draw_steps(seen[0], path),
        ),
    )
    return Findings(
        tables=(_descent_table(descents), _carried_table(seen), _filter_table(seen)),
        figures=figures,
        differences=(
            "The paper shows pictures without numbers, and begins near the border without saying how near; "
            f"ours begins {_OFF_PX:g} px off the truth, in the middle picture; in a sequence, at the truth.",
            "The paper's γ, which holds the edges to the guess, is not given: the tracker's 0.01 per px², and none.",
            "Figure 12 is left out: it shows another author's tracker, reference [25] there, of which no program "
            "is published. Figures 16 and 17 are left out: one picture each, cut into regions by a program and seeds "
            "that are not given, and without numbers.",
            "Figures 2 to 8 are drawings of the method.",
        ),
    )


def _look(sequence: Sequence, count: int) -> _LightResult:
    frames = rendered(sequence, count)
    tracker = EdgeTracker(KAPPA, NOSE_LENS.image_size_px, paper_config(GUESS))
    steps = [tracker.step(frame.image, frame.reported).edges for frame in frames]
    carried = {name: _carried(sequence, frames, name) for name in _ENERGIES}
    return _LightResult(sequence=sequence, frames=frames, carried=carried, steps=steps)


def _widths(sequence: Sequence, frame: NoseFrame, guess_px: FloatArray, rows_px: FloatArray) -> FloatArray:
    """Return the bands' widths (2, 2) about an initial value, px, by the sensors' pose."""
    half = 0.5 * sequence.airfield.width_m
    lines, e = np.array([1.0, 0.0, -half, half]), line_map(frame.reported, KAPPA)
    inner = project_lines(lines, e, rows_px)[0]
    outer = project_lines(shifted(lines, _BAND_M), e, rows_px)[0]
    return band_widths(guess_px, guess_px + outer - inner, rows_px, _LEAST_BAND_PX)


def _descended(one: Sequence, frame: NoseFrame, guess_px: FloatArray, energy: str, most: int) -> FloatArray:
    """Return the crossings (4,) where a descent of at most so many evaluations ends."""
    rows = true_edges(one, frame.truth)[1]
    kind, gamma = _ENERGIES[energy]
    config = replace(paper_config(GUESS, kind).descent, most_steps=most)
    config = config if gamma is None else replace(config, gamma=gamma)
    return descend(frame.image, guess_px, rows, _widths(one, frame, guess_px, rows), config).crossings_px


def _carried(sequence: Sequence, frames: list[NoseFrame], energy: str) -> FloatArray:
    """Return the crossings (n, 4) of a sequence, each started at the result before, the first at the truth."""
    most, found, last = _EVALUATIONS[-1], [], true_edges(sequence, frames[0].truth)
    for frame in frames:
        rows = true_edges(sequence, frame.truth)[1]
        guess = crossings_at(*last, rows)
        last = _descended(sequence, frame, guess, energy, most), rows
        found.append(last[0])
    return np.array(found)


def _descents(one: _LightResult) -> dict[str, list[float]]:
    """Return by energy the error after so many evaluations in the middle picture, px rms."""
    frame = one.frames[len(one.frames) // 2]
    wanted = true_edges(one.sequence, frame.truth)[0]
    return {
        name: [_rms(_descended(one.sequence, frame, wanted + _OFF_PX, name, most) - wanted) for most in _EVALUATIONS]
        for name in _ENERGIES
    }


def _rms(off: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.clip(off, -LOST_PX, LOST_PX) ** 2)))


def _descent_table(descents: dict[str, dict[str, list[float]]]) -> ResultTable:
    rows: list[list[Cell]] = [
        [light, name, *errors] for light, of_light in descents.items() for name, errors in of_light.items()
    ]
    return ResultTable(
        name="edge_descent",
        title="Figure 9: error in px (rms) after so many evaluations of the energy, one picture",
        columns=("sequence", "energy", *(f"{n}" for n in _EVALUATIONS)),
        rows=rows,
        notes=("The first evaluation is that of the guess.",),
    )


def _carried_table(seen: list[_LightResult]) -> ResultTable:
    rows: list[list[Cell]] = []
    for one in seen:
        wanted = np.array([true_edges(one.sequence, frame.truth)[0] for frame in one.frames])
        for name, found in one.carried.items():
            off = np.clip(found - wanted, -LOST_PX, LOST_PX)
            rows.append([one.sequence.name, name, len(off), _rms(off), float(np.median(np.abs(off))), _rms(off[-1])])
    return ResultTable(
        name="edge_carried",
        title="Figure 10: segmentation from picture to picture without a model, error in px",
        columns=("sequence", "energy", "frames", "rms px", "median px", "last frame's"),
        rows=rows,
    )


def _filter_table(seen: list[_LightResult]) -> ResultTable:
    rows: list[list[Cell]] = []
    for one in seen:
        errors: list[list[FloatArray]] = [[], [], []]
        for frame, edges in zip(one.frames, one.steps, strict=True):
            if edges is None or edges.measured_px is None:
                continue
            wanted = true_edges(one.sequence, frame.truth)
            there = crossings_at(*wanted, edges.rows_px)
            for own, found in zip(errors, (edges.predicted_px, edges.measured_px, edges.crossings_px), strict=True):
                own.append(found - there)
        cells: list[Cell] = [_rms(np.array(own)) if own else None for own in errors]
        rows.append([one.sequence.name, len(errors[0]), *cells])
    return ResultTable(
        name="edge_filter",
        title="Figure 11: the filter's steps, error in px (rms)",
        columns=("sequence", "frames with edges", "predicted", "measured", "estimated"),
        rows=rows,
        notes=("The paper's tracker, begun by its Algorithm 1; where it follows something else, all three do.",),
    )


def _draw_alone(seen: list[_LightResult], path: Path) -> None:
    sheets = []
    for one in seen:
        middle, last = one.frames[len(one.frames) // 2], one.frames[-1]
        wanted = true_edges(one.sequence, middle.truth)[0]
        pictures = []
        for frame in (middle, last):
            picture = frame.image.copy()
            true, rows = true_edges(one.sequence, frame.truth)
            draw_line(picture, _TRUE, true, rows)
            for name, colour in zip(_SHOWN, (_ONE, _OTHER), strict=True):
                guess = wanted + _OFF_PX
                alone = frame is middle and last is not middle
                most = _EVALUATIONS[-1]
                found = _descended(one.sequence, frame, guess, name, most) if alone else one.carried[name][-1]
                draw_line(picture, colour, found, rows)
            pictures.append(picture[_ROWS])
        sheets.append(np.hstack(pictures))
    cv2.imwrite(str(path), np.vstack(sheets))


def _draw_steps(one: _LightResult, path: Path) -> None:
    pictures = []
    start = max(0, len(one.frames) // 2 - _CONSECUTIVE)
    for frame, edges in list(zip(one.frames, one.steps, strict=True))[start : start + _CONSECUTIVE]:
        picture = frame.image.copy()
        if edges is not None:
            draw_line(picture, _BLUE, edges.predicted_px, edges.rows_px)
            if edges.measured_px is not None:
                draw_line(picture, (80, 255, 80), edges.measured_px, edges.rows_px)
            draw_line(picture, _TRUE, edges.crossings_px, edges.rows_px)
        pictures.append(picture[_ROWS])
    pictures += [np.zeros_like(pictures[0])] * (_CONSECUTIVE - len(pictures))
    cv2.imwrite(str(path), np.vstack([np.hstack(pictures[:2]), np.hstack(pictures[2:])]))
