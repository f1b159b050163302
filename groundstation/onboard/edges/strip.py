"""The energy of every small displacement of an edge at once, and the edge to a fraction of a pixel with its sigma.

Going down the energy ends in the nearest minimum: a painted stripe is one. A strip about the predicted edge,
straightened, holds u − v of each place and each displacement along the row; the energy of an edge displaced by α at
the upper and β at the lower row is a sum over it, so that a whole grid of (α, β) costs little. Two departures from
|u − v|²: neighbouring places are averaged before they are squared (at night the noise of one row is more than the
contrast), and the sum is of S / (S + κ), which no lamp or crossing taxiway carries alone. Not in the paper.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.coordinate_ascent import best_displacements
from groundstation.onboard.edges.edge_measurement import EdgeMeasurement
from groundstation.onboard.edges.strip_kernel import (
    displacement_scores,
    edges_agree,
    fill_strip,
    median_best_score,
    own_places,
    robust_line,
    usual_middle,
)

_LEAST_SIGMA_PX = 0.7


@dataclass(frozen=True, slots=True, kw_only=True)
class StripConfig:
    """Tuning of the strip.

    Attributes
    ----------
    places : along an edge.
    step_px : between displacements, up to ``fine_px`` of them; farther searches have wider steps, as many.
    fine_px, most_px : displacement up to which steps are not wider, and the largest one.
    window_px : largest deviation of a single place from the common edge.
    floor_px : lower limit of an edge's sigma: deviations from a straight line between two colours.
    block : neighbouring places that are averaged before they are squared; their errors are equal.
    least_contrast : mean of |u − v| (0 to 1, over the colours) below which there is no edge.
    """

    places: int = 40
    step_px: float = 0.5
    fine_px: float = 20.0
    most_px: float = 60.0
    window_px: float = 2.5
    floor_px: float = 0.25
    block: int = 5
    least_contrast: float = 0.008


def find_edges(
    image: ImageArray,
    guess_px: FloatArray,
    rows_px: FloatArray,
    widths_px: FloatArray,
    across: FloatArray,
    prior_px2: FloatArray,
    config: StripConfig,
) -> EdgeMeasurement | None:
    """Search both edges about initial crossings, wide first, and refine; None where one of them is not found."""
    crossings = search_edges(image, guess_px, rows_px, widths_px, across, prior_px2, config)
    return None if crossings is None else refine_edges(image, crossings, rows_px, widths_px, across, config)


def search_edges(
    image: ImageArray,
    guess_px: FloatArray,
    rows_px: FloatArray,
    widths_px: FloatArray,
    across: FloatArray,
    prior_px2: FloatArray,
    config: StripConfig,
) -> FloatArray | None:
    """Return the position of both edges (4,), to a step, about initial ones (4,) of covariance (4, 4); None: not found.

    ``widths_px`` (2, 2) and ``across`` (2,) as for `gradient_descent.descend`.
    """
    prior = prior_px2 + _LEAST_SIGMA_PX**2 * np.eye(4)
    reach = float(np.clip(3.0 * np.sqrt(prior.diagonal().max()) + 1.0, 3.0, config.most_px))
    step = config.step_px * max(1.0, reach / config.fine_px)
    strip = _strip(image, guess_px, rows_px, widths_px, across, reach, step, config.places)
    scores = np.empty((2, strip.shape[2], strip.shape[2]))
    for line in range(2):
        displacement_scores(strip[line], config.block, _kappa(strip[line], config.block), scores[line])
    # over the number of places: a score is a mean over them
    weight, displaced = np.linalg.inv(prior) / config.places, np.zeros(4)
    best = float(best_displacements(scores, 0.0, np.full(2, step), np.zeros(4), weight, displaced))
    return guess_px + displaced if math.isfinite(best) else None


def refine_edges(
    image: ImageArray,
    crossings_px: FloatArray,
    rows_px: FloatArray,
    widths_px: FloatArray,
    across: FloatArray,
    config: StripConfig,
) -> EdgeMeasurement | None:
    """Return the edges next to crossings (4,) to a fraction of a pixel; None where one is too faint or too short."""
    strip = _strip(
        image, crossings_px, rows_px, widths_px, across, config.window_px + 1.0, config.step_px, config.places
    )
    found, covariance, contrast = crossings_px.copy(), np.zeros((4, 4)), np.zeros(2)
    offsets, weights = np.zeros(config.places), np.zeros(config.places)
    for line in range(2):
        own = slice(2 * line, 2 * line + 2)
        ends, block = np.zeros(2), np.empty((2, 2))
        kappa = _kappa(strip[line], config.block)
        own_places(strip[line], config.step_px, config.block, config.window_px, kappa, offsets, weights)
        spread = float(robust_line(offsets, weights, ends, block))
        if spread < 0.0 or np.abs(ends).max() > 2.0 * config.window_px:
            return None
        contrast[line] = np.sqrt(float(usual_middle(strip[line], config.block)) / 3.0)
        found[own] += ends
        covariance[own, own] = config.block * spread**2 * block + config.floor_px**2 * np.eye(2)
    if contrast.min() < config.least_contrast:
        return None
    return EdgeMeasurement(
        crossings_px=found, covariance_px2=covariance, contrast=contrast, agreement=_agreement(strip, config.block)
    )


def _strip(
    image: ImageArray,
    x: FloatArray,
    rows: FloatArray,
    widths: FloatArray,
    across: FloatArray,
    reach: float,
    step: float,
    places: int,
) -> FloatArray:
    strip = np.zeros((2, places, 2 * int(np.ceil(reach / step)) + 1, 3))
    fill_strip(image, x, rows, widths, across, step, strip)
    return strip


def _agreement(strip: FloatArray, block: int) -> float:
    """Return the correlation of inside − outside at both edges, over blocks of places of a strip (2, …)."""
    return float(edges_agree(strip, block))


def _kappa(strip: FloatArray, block: int) -> float:
    """Return half the usual best |u − v|² of a block of places."""
    return max(0.5 * float(median_best_score(strip, block)), 1e-6)
