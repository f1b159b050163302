"""Evidence that tells layouts of a side line and lamps apart, in one picture.

Each block of rows can have any levels, so that a bright bar somewhere fits something: a side line is fitted as well by
lamps with both edges two metres farther in. What tells them apart is

- what a mark is free to fit (Occam's factor): its excess follows a common straight trend along both edges, as unevenly
  as it is seen to;
- blocks that are outliers: as such they have a share of the likelihood of the best of all layouts, so that a layout is
  not worth what a block alone would fit with it, with the edge elsewhere;
- how a mark varies along the edge: a line is a line, lamps are dots with a spacing, where rows are near enough to show
  it;
- the width between the edges: it was announced, mostly well.
"""

import math
from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.judging_kernel import MarkFreedom, judge, sum_variation
from groundstation.onboard.edges.layout_kernel import bar_information
from groundstation.onboard.edges.profile_config import ProfileConfig
from groundstation.onboard.edges.profile_fit import (
    GREY_AND_TINTS,
    EdgeProfiles,
    Layout,
    LayoutLevels,
    ProfileFit,
    best_displacement,
    layout_levels,
    layout_likelihoods,
    levels_at,
    picked_blocks,
)
from groundstation.onboard.edges.profile_kernel import QUANTUM, picked_trials
from groundstation.onboard.edges.width_prior import width_density

# sigmas by which paint has to exceed zero, and light darkness
_BRIGHT = 3.0
# a light's and a line's variance along the edge, over the square of their mean excess: usual values, and how far
# (in logarithms) either is from them; the least of both
_DOTS, _LINE, _VARIES, _LEAST_VARIANCE = 2.0, 0.2, 0.7, 0.05
# rows of which the variance is as one observation, and how many of these count at most
_ROWS_AS_ONE, _MOST_OBSERVED = 6.0, 6.0
# lamps are at least so far apart, m, and are seen apart in so many rows
_SPACING_M, _APART_ROWS = 30.0, 3.5
# what the levels of a block of rows are free to fit, nats a colour; the most that one block tells of an edge
_LEVELS_NATS, _MOST_BLOCK_NATS = 3.0, 10.0
# crossings (4,) of both lines with the same row
_SAME_ROW = np.tile(np.eye(2), (2, 2))


def weighed_layouts(
    profiles: EdgeProfiles, layouts: list[Layout], offset_px: FloatArray, weight: FloatArray, config: ProfileConfig
) -> list[ProfileFit]:
    """Return the likelihoods of layouts with all that tells them apart but the width.

    A prior with its mean at ``offset_px`` (4,) and this inverse covariance (4, 4) selects the lines about which each
    layout's marks are looked at.
    """
    found = layout_levels(profiles, layouts, None, config.wide)
    trials = found.misfit.shape[3]
    known = np.empty((2, len(layouts), 2, found.misfit.shape[2], trials))
    for line in range(2):
        bar_information(profiles.weight[line], profiles.blurs[line], found.bars[line], trials, known[line])
    misfit, along = found.misfit.copy(), np.zeros(len(layouts))
    for k, fit in enumerate(_likelihoods(profiles, found, found.misfit, config)):
        moved_px = best_displacement(fit, offset_px, weight).moved_px
        misfit[:, k] = _judged(profiles, found, k, moved_px, known[:, k], config)
        along[k] = _along(profiles, found, k, fit, moved_px)
    fits = _likelihoods(profiles, found, misfit, config)
    return [replace(fit, base=fit.base + float(own)) for fit, own in zip(fits, along, strict=True)]


def same_row_prior(scale: FloatArray, config: ProfileConfig) -> FloatArray:
    """Return the inverse covariance (4, 4) of displacements by another layout: both edges farther out or in."""
    apart = np.diag(np.maximum(config.apart_m * scale, config.least_step_px) ** 2)
    return np.asarray(np.linalg.inv(apart + config.outwards_m**2 * np.outer(scale, scale) * _SAME_ROW), np.float64)


def limited(better: float, config: ProfileConfig) -> float:
    """Return a picture's gain, of which no more counts than so much, whichever way."""
    return config.picture_limit * math.tanh(better / config.picture_limit)


def width_likelihood(profiles: EdgeProfiles, moved_px: FloatArray, scale: FloatArray) -> float:
    """Return the log-likelihood of the width between lines displaced by (4,) px outwards, 0 for the announced one.

    ``scale`` (4,) px in a metre. Announced widths are mostly right, and otherwise off by a fifth.
    """
    prior = profiles.view.width
    if prior is None:
        return 0.0
    moved_m = moved_px / scale
    width_m = profiles.width_m + 0.5 * float(moved_m.sum())
    return width_density(width_m, prior)


def _likelihoods(
    profiles: EdgeProfiles, found: LayoutLevels, misfit: FloatArray, config: ProfileConfig
) -> list[ProfileFit]:
    """Return likelihoods of which an outlier's is the same for all layouts."""
    least = np.broadcast_to(misfit.min(axis=(1, 3))[:, None, :], misfit.shape[:3])
    return layout_likelihoods(profiles, found, misfit, least, config.values_as_one, config.layout_outlier)


def _judged(
    profiles: EdgeProfiles, found: LayoutLevels, k: int, moved_px: FloatArray, known: FloatArray, config: ProfileConfig
) -> FloatArray:
    """Return the misfits (2, blocks, trials) of a layout with what its marks are free to fit.

    Their expected excess is a straight trend along both edges; a block may be as far from it as it is seen to be,
    within limits: paint sampled by few pixels is not alike, and many lamps in a row are. ``known`` (2, bars, blocks,
    trials): `bar_information` of both lines.
    """
    free = MarkFreedom(
        most=np.array([config.paint_spread, config.light_spread]),
        least=config.least_spread,
        floor=config.mark_least,
        weight=profiles.coarse / config.values_as_one,
    )
    misfit = np.ascontiguousarray(found.misfit[:, k])
    out, picked = np.empty_like(misfit), np.empty(misfit.shape[:2], np.int64)
    picked_trials(misfit.shape[2], profiles.steps, moved_px, picked)
    levels, known = np.ascontiguousarray(found.levels[:, k]), np.ascontiguousarray(known)
    judge(misfit, levels, known, found.freedom, picked, free, out)
    return out


def _along(profiles: EdgeProfiles, found: LayoutLevels, k: int, fit: ProfileFit, moved_px: FloatArray) -> float:
    """Return the log-likelihood of how a layout's only mark varies along the edges, in rows that are near enough."""
    view, blocks = profiles.view, fit.misfit.shape[1]
    marked = [found.bars[0, k, bar, 0, 0] < found.bars[0, k, bar, 0, 1] for bar in range(2)]
    if view.along_m is None or marked[0] == marked[1]:
        return 0.0
    bar = 1 if marked[1] else 0
    t = (np.arange(blocks) + 0.5) / blocks
    # metres in a row grow as its distance's square: their inverse root is straight along the edge
    along_m = (view.along_m[0] ** -0.5 * (1.0 - t) + view.along_m[1] ** -0.5 * t) ** -2
    near = _SPACING_M / along_m >= _APART_ROWS
    if not near.any():
        return 0.0
    moved = np.asarray(picked_blocks(fit, moved_px) - fit.misfit.shape[2] // 2, np.float64)
    level = np.asarray(levels_at(fit, moved_px)[:, :, 2 + bar].mean(axis=2), np.float64)
    bars = np.ascontiguousarray(found.bars[:, k, bar])
    seen = sum_variation(profiles.total, profiles.weight, profiles.squares, bars, moved, level, near)
    if seen.rows < 2.0 or seen.square <= 0.0:
        return 0.0
    return varying(seen.own, seen.usual, seen.square, seen.rows, lamps=bar == 1)


def varying(own: float, usual: float, square: float, rows: float, *, lamps: bool) -> float:
    """Return the log-likelihood of a mark's variance along the edge as that of lamps, or of a line.

    ``own``, ``usual`` and ``square``: sums over rows of the variance in the mark, of that elsewhere, and of the
    square of its mean excess. Where noise hides it, it says little.
    """
    ratio = max(own - usual, 0.0) / square + _LEAST_VARIANCE
    hidden = math.sqrt(2.0 / rows) * usual / square / ratio
    sigma = math.hypot(_VARIES, hidden)
    off = (math.log(ratio) - math.log(_DOTS if lamps else _LINE)) / sigma
    return -0.5 * off**2 * min(rows / _ROWS_AS_ONE, _MOST_OBSERVED) * (_VARIES / sigma) ** 2


def is_bright(paint: FloatArray) -> bool:
    """Return whether paint (2, blocks), which is equal all along, is significant."""
    return bool(paint.mean() >= _BRIGHT * paint.std() / math.sqrt(paint.size))


def is_lit(light: FloatArray) -> bool:
    """Return whether the light of lamps (2, blocks), which is not in every block, is more than darkness."""
    return bool(np.maximum(light, 0.0).sum() >= _BRIGHT * np.maximum(-light, 0.0).sum())


def seen_at_all(profiles: EdgeProfiles, fit: ProfileFit, moved_px: FloatArray, values_as_one: float) -> FloatArray:
    """Return the log-likelihood (2,) of both edges with their marks over ground that is the same on both sides.

    Less what their levels are free to fit and where the edge may be anywhere in the window: below zero pictures without
    an edge have as good ones.
    """
    total = profiles.total @ GREY_AND_TINTS.T
    weight = np.maximum(profiles.weight, 1e-9)
    whole = weight.sum(axis=2)
    flat = (total**2 / weight[..., None]).sum(axis=2) - total.sum(axis=2) ** 2 / whole[..., None]
    floor = QUANTUM * whole
    alone = np.sqrt((flat[..., 0] + floor) * (flat[..., 1:].sum(axis=2) + floor))
    picked = picked_blocks(fit, moved_px)
    misfit = np.take_along_axis(fit.misfit, picked[:, :, None], axis=2)[:, :, 0]
    power = 0.5 * profiles.coarse * fit.freedom / values_as_one
    free = 1.5 * profiles.coarse / values_as_one * _LEVELS_NATS
    gains = power * np.log(np.maximum(alone, 1e-9) / np.maximum(misfit, 1e-9)) - free
    anywhere = 2.0 * math.log(fit.misfit.shape[2])
    return np.asarray(np.minimum(gains, _MOST_BLOCK_NATS).sum(axis=1) - anywhere)
