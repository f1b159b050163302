"""Systematic errors of corners, the same in every picture: modes of one sigma each, as columns in px of all corners.

For tracked edges they follow from the tracker's own covariance (`Edges.systematic_px2`), which contains the ambiguity
of the markings and is checked against truth. Sides and corners that are measured without the tracker are not
distinguished from paint and lamps; their errors are assumed from the light. Thresholds are measured here in any case.
"""

from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.report import Edges
from groundstation.onboard.pose.runway import Runway
from groundstation.onboard.visual_inertial.config import ApproachConfig, CornerMethod

# modes of constant errors of edges: both on the ground, four ends; of tracked ones the four ends
_EDGE_MODES, _TRACKED_MODES = 6, 4
# two thresholds shifted and turned
_THRESHOLD_MODES = 4


def edge_mode_count(method: CornerMethod) -> int:
    """Return how many of the columns are the edges', the first ones."""
    return _TRACKED_MODES if method is CornerMethod.EDGES else _EDGE_MODES


def mode_count(method: CornerMethod) -> int:
    """Return how many columns there are."""
    return edge_mode_count(method) + _THRESHOLD_MODES


def systematic_sigmas(config: ApproachConfig, levels: float, *, dark: bool) -> ApproachConfig:
    """Return the tuning with the constant errors of edges in this light.

    The fainter the pavement, the farther its edge is biased by other structures; by night it is biased to lamps.
    """
    faint = float(np.clip(config.clear_levels / max(levels, 1.0), 1.0, config.most_faint))
    side_m, side_px = config.side_sigma_m, faint * config.side_sigma_px
    if dark:
        side_m, side_px = max(side_m, config.lamp_sigma_m), max(side_px, config.lamp_sigma_px)
    return replace(config, side_sigma_m=side_m, side_sigma_px=side_px)


def systematic_modes(pixels: FloatArray, runway: Runway, config: ApproachConfig) -> FloatArray:
    """Return the columns (8, 10) of what lasts: both edges on the ground and at each end, both thresholds.

    Sigmas of the edges as configured.
    """
    columns = []
    # pairs of corners: left side (near, far), right side (near, far)
    for near, far in ((0, 1), (3, 2)):
        shift = np.zeros((4, 2))
        for k, other in ((near, 3 - near), (far, 3 - far)):
            across = pixels[other] - pixels[k]
            shift[k] = config.side_sigma_m * across / runway.width_m
        columns.append(shift.ravel())
    for k in range(4):
        end = np.zeros((4, 2))
        end[k, 0] = config.side_sigma_px
        columns.append(end.ravel())
    return np.stack([*columns, *_threshold_modes(pixels, runway, config)], axis=1)


def tracked_modes(pixels: FloatArray, edges: Edges, runway: Runway, config: ApproachConfig) -> FloatArray:
    """Return the columns (8, 8) of the constant errors of corners (4, 2) on tracked edges: the tracker's, thresholds.

    Of all roots of its covariance the symmetric one is used: it changes as little from picture to picture as the
    covariance does, so that a column is the same error in all of them.
    """
    values, vectors = np.linalg.eigh(edges.systematic_px2)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    moved = np.zeros((4, 2, _TRACKED_MODES))
    for k, corner in enumerate(pixels):
        # corners 0 and 1 are on the left edge
        ends = slice(0, 2) if k < 2 else slice(2, 4)
        moved[k, 0] = weights_of_ends(edges, float(corner[1])) @ root[ends]
    return np.hstack([moved.reshape(8, -1), np.stack(_threshold_modes(pixels, runway, config), axis=1)])


def width_mode(pixels: FloatArray, width_sigma: float) -> FloatArray:
    """Return the column (8,) of a runway that is wider than announced by one sigma, as a share of its width.

    Each corner is farther out along its threshold, by half of that.
    """
    moved = np.zeros((4, 2))
    for k in range(4):
        moved[k] = 0.5 * width_sigma * (pixels[k] - pixels[3 - k])
    return moved.ravel()


def weights_of_ends(edges: Edges, row_px: float) -> FloatArray:
    """Return how a line's place in a row follows from its crossings with the upper and the lower row, (2,)."""
    upper, lower = edges.rows_px
    share = (row_px - upper) / (lower - upper)
    return np.array([1.0 - share, share])


def _threshold_modes(pixels: FloatArray, runway: Runway, config: ApproachConfig) -> list[FloatArray]:
    """Return four columns (8,): either threshold shifted along the runway (its corners along the sides), and turned."""
    columns = []
    for pair, along_m, sigma_px in (
        (((0, 1), (3, 2)), config.near_sigma_m, config.end_sigma_px),
        (((1, 0), (2, 3)), 0.0, config.far_end_sigma_px),
    ):
        shift, turned = np.zeros((4, 2)), np.zeros((4, 2))
        for sign, (k, other) in zip((1.0, -1.0), pair, strict=True):
            side = pixels[other] - pixels[k]
            # a metre takes more of the side's picture at its near end than on its average
            by_metres = along_m / runway.length_m * _stretch(pixels, k, other)
            by_blur = sigma_px / max(abs(float(side[1])), 1.0)
            shift[k] = np.hypot(by_metres, by_blur) * side
            # the same with its ends opposite: a threshold that seems turned
            turned[k] = sign * by_blur * side
        columns += [shift.ravel(), turned.ravel()]
    return columns


def _stretch(pixels: FloatArray, k: int, other: int) -> float:
    """Return how much longer a metre appears at one end of a side than on its average: the widths' ratio."""
    widths = [float(np.linalg.norm(pixels[i] - pixels[3 - i])) for i in (k, other)]
    return widths[0] / max(widths[1], 1.0)
